"""Count identifiers that use words a lint refuses, package by package.

Run from the repository root:

    python tests/words_lint.py                   one line of counts
    python tests/words_lint.py --list            every refused identifier as file:line: kind name (stem)
    python tests/words_lint.py --stems           the count of each stem
    python tests/words_lint.py --change main     only lines added since a git revision; exit code 1 if any
    python tests/words_lint.py --max 1600        exit code 1 if there are more (a ratchet for CI)
    python tests/words_lint.py --tests-by-name   count the names of test functions too
    python tests/words_lint.py --strict          refuse the discouraged stems as well
    python tests/words_lint.py --spelling        count British spellings instead

Checked: names of modules, classes, functions, arguments, class attributes (NamedTuple and dataclass fields, enum
members, class variables) and instance attributes (``self.x = ...``). ``--all`` adds module constants and local
variables. Names of test functions are left out unless --tests-by-name is given, because they are sentences.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import ast
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

PACKAGES = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation", "tests")


def _word_set(text: str) -> frozenset[str]:
    return frozenset(text.split())


REFUSED = _word_set(
    """
    tell tells told telling untold say says said saying unsaid ask asks asked asking unasked
    hold holds held holding see saw seen unseen hear hears heard hearing unheard felt found flown flew
    beside apart room rooms shelf hush doubt doubts doubted doubtful suspect suspects suspected suspicion
    lack lacks lacking still own ours theirs go goes going gone went begun began
    who whose whom nobody somebody anybody everybody whoever whatever wish wishes wished wanted
    believe believed believes weigh weighed patience tally tallies verdict complain complaint complaints
    welcome hurry hurried noted placing gathering remembered forget forgot
    thrown blown blow lies lain mends mended anew afresh alike
    """
)
"""Words of which each has a standard term; matched as whole words of snake_case and CamelCase names."""

DISCOURAGED = _word_set(
    """
    begin begins kept keep keeps taken took given made makes come comes came became put puts
    place places placed way ways thing things piece pieces stretch stretches
    whole turned share shares spread drawn picture pictures silence silent quiet mute dead alive born
    reach reached alone again there here where why what nothing most greatest joined shortened widened exchanged
    differing lasting truths bird outward along across listing look looks looked watch watched
    """
)
"""Plain words that are legitimate in places but usually stand for a more exact one; refused with --strict only."""

BRITISH = _word_set(
    """
    manoeuvre manoeuvres colour colours coloured centre centres centred centring metre metres behaviour neighbour
    neighbours aerofoil aerofoils aeroplane aeroplanes linearise linearised linearises normalise normalised
    optimise optimised initialise initialised synchronise synchronised stabilise stabilised minimise minimised
    analyse analysed modelled labelled cancelled travelled grey licence organised recognised characterised
    digitised parametrised favour programme
    """
)
"""British spellings; --spelling counts these instead."""

ALLOWED_PHRASES = (
    # flight modes, discretisation and loop states in which "hold" is the standard word
    r"(?:altitude|heading|position|attitude|pitch|roll|bank|airspeed|course|track|loiter|trim|brake)_hold",
    r"(?:zero|first)_order_hold",
    r"sample_(?:and_)?hold",
    r"hold_(?:altitude|heading|position|attitude|airspeed|trim|time|duration)",
    r"(?:held|hold)_out",  # cross-validation: held-out data
    # other idioms of the field
    r"not_found",
    r"still_air",
    r"last_seen",
    r"first_seen",
    r"go_around",
    r"go_to",
    r"lack_of_fit",
    r"own_ship",
    r"dead_(?:reckoning|band|zone|time)",
    r"along_(?:track|wind)",
)
"""Matched in the snake_case form of a name and taken out of it before its words are checked."""

ALLOWED_NAMES = frozenset({"HOLD", "SUSPECT"})
"""Exact names: a mission item and flight mode (MAVLink, ArduPilot), a telemetry quality flag."""

ALLOWED_IN = frozenset(
    {
        ("logs/summary.py", "hold"),  # key of the JSON summary of a flight
        # a key of the user's map file; alias it before renaming
        ("logs/identification/sources/table/config.py", "hold"),
    }
)
"""Names that a file format, a MAVLink parameter, a topic or a JSON key of users depends on: (file, name)."""

_WORDS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_HUNK = re.compile(r"^@@ -\d+(?:,(\d+))? \+(\d+)(?:,(\d+))? @@")


class Identifier(NamedTuple):
    """One definition of a name."""

    file: str
    line: int
    kind: str
    name: str


class Finding(NamedTuple):
    """An identifier with the stem for which it is refused."""

    identifier: Identifier
    stem: str


class Options(NamedTuple):
    """Which definitions are checked."""

    everything: bool
    test_names: bool


def snake_case(name: str) -> str:
    """``ToldBoard`` and ``TOLD_BOARD`` as ``told_board``."""
    return "_".join(word.lower() for word in _WORDS.findall(name))


def refused_stem(identifier: Identifier, stems: frozenset[str]) -> str:
    """The first refused word of a name; empty if there is none."""
    if identifier.name in ALLOWED_NAMES or (identifier.file, identifier.name) in ALLOWED_IN:
        return ""
    text = f"_{snake_case(identifier.name)}_"
    for phrase in ALLOWED_PHRASES:
        text = re.sub(rf"(?<=_){phrase}(?=_)", "", text)
    return next((word for word in text.split("_") if word in stems), "")


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) -> Iterator[ast.arg]:
    spec = node.args
    yield from (*spec.posonlyargs, *spec.args, *spec.kwonlyargs)
    yield from (each for each in (spec.vararg, spec.kwarg) if each is not None)


def _targets(node: ast.AST) -> Iterator[ast.expr]:
    if isinstance(node, ast.Assign):
        yield from node.targets
    elif isinstance(node, (ast.AnnAssign, ast.AugAssign, ast.For, ast.AsyncFor, ast.NamedExpr, ast.comprehension)):
        yield node.target
    elif isinstance(node, (ast.With, ast.AsyncWith)):
        yield from (item.optional_vars for item in node.items if item.optional_vars is not None)


def _names(target: ast.expr) -> Iterator[ast.Name | ast.Attribute]:
    if isinstance(target, (ast.Name, ast.Attribute)):
        yield target
    elif isinstance(target, (ast.Tuple, ast.List)):
        for each in target.elts:
            yield from _names(each)
    elif isinstance(target, ast.Starred):
        yield from _names(target.value)


_LEAVES = (ast.Name, ast.Constant, ast.expr_context, ast.operator, ast.cmpop, ast.boolop, ast.unaryop)
"""nodes without definitions below them: half of all"""


class _Collector(ast.NodeVisitor):
    """Collects the definitions of one file; a name counts once in its scope."""

    def __init__(self, file: str, options: Options) -> None:
        self.definitions: list[Identifier] = []
        self._file = file
        self._options = options
        self._scopes: list[ast.AST] = []
        self._keys: set[tuple[int, str, str]] = set()

    def _add(self, line: int, kind: str, name: str, scope: ast.AST | None) -> None:
        key = (id(scope), kind, name)
        if key not in self._keys:
            self._keys.add(key)
            self.definitions.append(Identifier(self._file, line, kind, name))

    def _enter(self, node: ast.AST) -> None:
        self._scopes.append(node)
        self.generic_visit(node)
        self._scopes.pop()

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._add(node.lineno, "class", node.name, node)
        self._enter(node)

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        is_test = self._file.startswith("tests/") and node.name.startswith("test_")
        if self._options.test_names or not is_test:
            self._add(node.lineno, "function", node.name, node)
        for argument in _arguments(node):
            self._add(argument.lineno, "argument", argument.arg, node)
        self._enter(node)

    visit_FunctionDef = _function  # noqa: N815
    visit_AsyncFunctionDef = _function  # noqa: N815

    def visit_Lambda(self, node: ast.Lambda) -> None:
        for argument in _arguments(node):
            self._add(argument.lineno, "argument", argument.arg, node)
        self._enter(node)

    def generic_visit(self, node: ast.AST) -> None:
        for target in _targets(node):
            for name in _names(target):
                self._assigned(name, is_statement=isinstance(node, (ast.Assign, ast.AnnAssign)))
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, _LEAVES):
                self.visit(child)

    def _assigned(self, target: ast.Name | ast.Attribute, is_statement: bool) -> None:
        scope = self._scopes[-1] if self._scopes else None
        if isinstance(target, ast.Attribute):
            if isinstance(target.value, ast.Name) and target.value.id == "self":
                owner = next((each for each in reversed(self._scopes) if isinstance(each, ast.ClassDef)), scope)
                self._add(target.lineno, "attribute", target.attr, owner)
        elif isinstance(scope, ast.ClassDef) and is_statement:
            self._add(target.lineno, "attribute", target.id, scope)
        elif self._options.everything:
            self._add(target.lineno, "variable" if scope else "constant", target.id, scope)


def identifiers(path: Path, root: Path, options: Options) -> list[Identifier]:
    """All definitions in one file, its own module name first.

    Raises:
        SyntaxError: the file is not Python.
    """
    file = path.relative_to(root).as_posix()
    collector = _Collector(file, options)
    if path.stem != "__init__":
        collector.definitions.append(Identifier(file, 0, "module", path.stem))
    collector.visit(ast.parse(path.read_bytes(), filename=file))
    return collector.definitions


def all_identifiers(root: Path, options: Options) -> list[Identifier]:
    """Definitions in all packages below ``root``, by file and line."""
    definitions = []
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            definitions += sorted(identifiers(path, root, options), key=lambda one: one.line)
    return definitions


def findings(definitions: Sequence[Identifier], stems: frozenset[str]) -> list[Finding]:
    """The refused ones, each with its stem."""
    return [Finding(each, stem) for each in definitions if (stem := refused_stem(each, stems))]


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(("git", *arguments), cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip() or f"git {arguments[0]} failed")
    return done.stdout


def added_lines(root: Path, base: str) -> dict[str, set[int]]:
    """Line numbers added in the working tree since ``base``, by file; line 0 if the file itself is new or renamed.

    Raises:
        RuntimeError: git reports an error.
    """
    commit = _git(root, "rev-parse", "--verify", "--end-of-options", f"{base}^{{commit}}").strip()
    # Options fix the format of the diff whatever the user's git configuration says.
    flags = ("-M", "--no-color", "--no-ext-diff", "--no-textconv", "--relative")
    form = ("-c", "core.quotePath=false", "diff", *flags, commit)
    added: dict[str, set[int]] = {}
    new = _git(root, *form, "--name-only", "--diff-filter=AR", "--", "*.py")
    untracked = _git(root, "-c", "core.quotePath=false", "ls-files", "--others", "--exclude-standard", "--", "*.py")
    for file in (*new.splitlines(), *untracked.splitlines()):
        added.setdefault(file, set()).add(0)
    for file in untracked.splitlines():
        added[file].update(range(1, (root / file).read_bytes().count(b"\n") + 2))
    current: set[int] = set()
    diff = _git(root, *form, "-U0", "--src-prefix=a/", "--dst-prefix=b/", "--", "*.py")
    skip = 0
    for line in diff.split("\n"):
        hunk = _HUNK.match(line)
        if skip > 0:  # a line of a hunk, whatever it looks like; "\\ No newline" is none
            skip -= not line.startswith("\\")
        elif line.startswith("+++ "):
            current = added.setdefault(line[6:].rstrip("\t"), set())
        elif hunk:
            removed, start, count = int(hunk[1] or 1), int(hunk[2]), int(hunk[3] or 1)
            current.update(range(start, start + count))
            skip = removed + count
    return added


def summary(refused: Sequence[Finding], checked: int) -> str:
    """One line: how many of the identifiers that were checked are refused, and the count of each package."""
    counts = Counter(each.identifier.file.partition("/")[0] for each in refused)
    parts = ", ".join(f"{package} {counts[package]}" for package in PACKAGES)
    return f"{len(refused)} refused identifiers in {checked} ({parts})"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Count identifiers that use refused words.")
    parser.add_argument("--list", action="store_true", help="print each refused identifier with file:line")
    parser.add_argument("--stems", action="store_true", help="print the count of each stem")
    parser.add_argument("--change", metavar="BASE", help="check only lines added since this git revision")
    parser.add_argument("--max", type=int, metavar="N", help="fail if there are more than N")
    parser.add_argument("--strict", action="store_true", help="also refuse the discouraged stems")
    parser.add_argument("--spelling", action="store_true", help="count British spellings instead")
    parser.add_argument("--all", action="store_true", help="also check module constants and local variables")
    parser.add_argument("--tests-by-name", action="store_true", help="also check the names of test functions")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Exit code: 0 if accepted, 1 if refused (--change, --max), 2 if a file or revision cannot be read."""
    options = _parser().parse_args(arguments)
    stems = BRITISH if options.spelling else REFUSED | DISCOURAGED if options.strict else REFUSED
    root = Path.cwd()
    if not any((root / package).is_dir() for package in PACKAGES):
        print(f"words_lint: none of {', '.join(PACKAGES)} is in the current directory", file=sys.stderr)
        return 2
    try:
        definitions = all_identifiers(root, Options(options.all, options.tests_by_name))
        if options.change is not None:
            added = added_lines(root, options.change)
            definitions = [one for one in definitions if one.line in added.get(one.file, ())]
    except (SyntaxError, RuntimeError, UnicodeDecodeError, OSError) as error:
        print(f"words_lint: {error}", file=sys.stderr)
        return 2
    refused = findings(definitions, stems)
    if options.list:
        for (file, line, kind, name), stem in refused:
            print(f"{file}:{max(line, 1)}: {kind} {name} ({stem})")
    if options.stems:
        for stem, count in Counter(one.stem for one in refused).most_common():
            print(f"{count:6} {stem}")
    print(summary(refused, len(definitions)))
    limit = options.max if options.max is not None else 0 if options.change is not None else None
    return int(limit is not None and len(refused) > limit)


if __name__ == "__main__":
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # --list | head
    sys.exit(main())
