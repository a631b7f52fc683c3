"""The second tab: messages with rates and fields."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.message import Message
from textual.widgets import DataTable

from groundstation.link.traffic import MessageRow
from groundstation.views import inspector
from groundstation.views.terminal import plain_text


class MessagesTab(Horizontal):
    """Message inspector tab."""

    class Chosen(Message):
        """Event: a field was selected for a plot."""

        def __init__(self, path: str) -> None:
            super().__init__()
            self.path = path

    def __init__(self) -> None:
        super().__init__()
        self._rows: dict[str, MessageRow] = {}
        self._shown = ""

    def compose(self) -> ComposeResult:
        """Compose messages on the left, fields on the right."""
        yield DataTable[Text](id="kinds", cursor_type="row", zebra_stripes=True)
        yield DataTable[Text](id="fields", cursor_type="row", zebra_stripes=True)

    def on_mount(self) -> None:
        """Set the column names."""
        for name in inspector.COLUMNS:
            self._kinds.add_column(name, key=name)
        for name in ("field", "value", "unit"):
            self._fields.add_column(name, key=name)
        self._fields.border_title = "fields: enter plots one"

    @property
    def _kinds(self) -> DataTable[Text]:
        return self.query_one("#kinds", DataTable)

    @property
    def _fields(self) -> DataTable[Text]:
        return self.query_one("#fields", DataTable)

    def show(self, rows: Sequence[MessageRow]) -> None:
        """Draw the present data; rows keep their order, a new message type is inserted."""
        table = self._kinds
        known = self._rows
        self._rows = {f"{row.name} {row.sender}": row for row in rows}
        if set(known) != set(self._rows):
            self._fill()
        else:
            for key, row in self._rows.items():
                for name, cell in zip(inspector.COLUMNS, inspector.message_cells(row), strict=True):
                    table.update_cell(key, name, plain_text(cell))
        self._show_fields()

    def _fill(self) -> None:
        table = self._kinds
        present = self._key()
        table.clear()
        for key, row in self._rows.items():
            table.add_row(*map(plain_text, inspector.message_cells(row)), key=key)
        if present in self._rows:
            table.move_cursor(row=list(self._rows).index(present))

    def _key(self) -> str:
        table = self._kinds
        if not table.row_count:
            return ""
        return str(table.coordinate_to_cell_key(table.cursor_coordinate).row_key.value)

    def _show_fields(self) -> None:
        key = self._key()
        if key not in self._rows:
            return
        fields = inspector.field_rows(self._rows[key].message)
        table = self._fields
        if key != self._shown or table.row_count != len(fields):
            self._shown = key
            table.clear()
            for field in fields:
                table.add_row(*map(plain_text, field), key=field.path)
            return
        for field in fields:
            table.update_cell(field.path, "value", plain_text(field.value))

    def on_data_table_row_highlighted(self, event: DataTable.RowHighlighted) -> None:
        """Show the fields of another message."""
        if event.data_table is self._kinds:
            self._show_fields()

    def on_data_table_row_selected(self, event: DataTable.RowSelected) -> None:
        """Move from a message to its fields, or from a field to its plot."""
        if event.data_table is self._kinds:
            self._fields.focus()
        elif self._shown:
            name = self._rows[self._shown].name
            self.post_message(self.Chosen(f"{name}.{event.row_key.value}"))
