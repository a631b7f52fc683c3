"""Confirmation dialogs and mode selection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Label, OptionList

from groundstation.views.printable import printable


class Confirmation(ModalScreen[bool]):
    """Confirmation dialog; only ``y`` confirms."""

    BINDINGS: ClassVar[list[BindingType]] = [("y", "answer(True)", "Yes"), ("n,escape", "answer(False)", "No")]

    def __init__(self, question: str, warning: str = "") -> None:
        super().__init__()
        self._question, self._warning = question, warning

    def compose(self) -> ComposeResult:
        """Compose the question, its explanation, and the keys."""
        with Vertical(classes="dialog"):
            yield Label(printable(self._question), classes="question", markup=False)
            if self._warning:
                yield Label(printable(self._warning), classes="warning", markup=False)
            yield Label("[b]y[/b] yes    [b]n[/b] no", classes="keys")

    def action_answer(self, answer: bool) -> None:
        """Close with the answer."""
        self.dismiss(answer)


class ModeChoice(ModalScreen[str | None]):
    """List of the vehicle's modes."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape", "leave", "Leave it")]

    def __init__(self, names: Sequence[str], present: str) -> None:
        super().__init__()
        self._names, self._present = list(names), present

    def compose(self) -> ComposeResult:
        """Compose a list of names with the present one selected."""
        with Vertical(classes="dialog"):
            yield Label("flight mode", classes="question")
            yield OptionList(*map(printable, self._names), markup=False)

    def on_mount(self) -> None:
        """Highlight the present mode."""
        modes = self.query_one(OptionList)
        if self._present in self._names:
            modes.highlighted = self._names.index(self._present)
        modes.focus()

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Close with the name."""
        self.dismiss(self._names[event.option_index])

    def action_leave(self) -> None:
        """Close without a choice."""
        self.dismiss(None)
