"""Findings: what a diagnostic reports about data, a model or an estimate, by code.

Program logic compares codes and severities. The text is made here, from the catalog and the finding's values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, NamedTuple

Severity = Literal["info", "warning", "withheld"]
"""info: what was done; warning: it casts doubt on a number; withheld: the number does not exist"""


class Finding(NamedTuple):
    """One result of one check."""

    code: str
    """-; key of `CATALOG`"""
    severity: Severity
    subject: str = ""
    """-; parameter, signal, maneuver or method concerned; empty for all"""
    value: float | None = None
    """as the check's unit; what was found"""
    limit: float | None = None
    """as `value`; what it was compared with"""
    details: Mapping[str, Any] = {}
    """further values of the text, by name"""

    @property
    def text(self) -> str:
        """One clause made from the catalog."""
        return self._filled(CATALOG[self.code].text)

    @property
    def remedy(self) -> str:
        """What to do, made from the catalog; empty if nothing is to be done."""
        return self._filled(CATALOG[self.code].remedy)

    @property
    def line(self) -> str:
        """The subject, text and remedy; the subject of a withheld one stands elsewhere."""
        remedy = self.remedy
        text = f"{self.text}; {remedy}" if remedy and self.severity != "info" else self.text
        named = not self.subject or self.subject in text or self.severity == "withheld"
        return text if named else f"{self.subject}: {text}"

    def _filled(self, template: str) -> str:
        values = {"subject": self.subject, "value": self.value, "limit": self.limit} | dict(self.details)
        return template.format_map(values)

    def document(self) -> dict[str, Any]:
        """Keys of the JSON document."""
        kept = self._asdict()
        del kept["details"]
        return kept | {"text": self.text}


class Entry(NamedTuple):
    """What a code means."""

    text: str
    """-; template of the clause: `str.format` with the finding's fields and details"""
    meaning: str
    """-; one sentence for the documentation"""
    remedy: str = ""
    """-; template of what to do, one clause; empty if nothing is to be done"""


CATALOG: dict[str, Entry] = {}
"""by code; `register` adds to it"""


def register(entries: Mapping[str, Entry]) -> None:
    """Add the codes of one module.

    Raises:
        ValueError: a code is there already.
    """
    twice = CATALOG.keys() & entries.keys()
    if twice:
        raise ValueError(f"finding codes are registered twice: {', '.join(sorted(twice))}")
    CATALOG.update(entries)


def not_estimated(subject: str, reason: str) -> Finding:
    """The finding of a parameter without an estimate."""
    return Finding("not_estimated", "withheld", subject, details={"reason": reason})


def note(text: str) -> Finding:
    """A remark on what was read, filled or decided."""
    return Finding("note", "info", details={"note": text})


def of_severity(findings: Iterable[Finding], severity: Severity) -> tuple[Finding, ...]:
    """Those of one severity, in their order."""
    return tuple(one for one in findings if one.severity == severity)


register({
    "not_identifiable": Entry(
        "the data does not determine it apart from {others}",
        "The information matrix is singular along a direction that contains the parameter.",
        "fix one of the parameters, or fly another input",
    ),
    "no_effect": Entry(
        "it has no effect on the fitted outputs", "The sensitivity of every fitted output to the parameter is zero."
    ),
    "at_bound": Entry("it stays at its bound {value:g}", "The likelihood increases beyond the bound."),
    "not_converged": Entry("the search did not converge: {reason}", "The iteration ended before its threshold."),
    "not_estimated": Entry("{reason}", "The method gives no number for this parameter or mode."),
    "note": Entry("{note}", "A remark of a source or an estimator on what was read, filled or decided."),
})  # fmt: skip
