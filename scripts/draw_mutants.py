"""Draw mutants of rooms, run the rooms' tests on each, and print which survive.

    python scripts/draw_mutants.py --rooms metrics,fusion --count 10 --seed 1
    python scripts/draw_mutants.py --rooms nn --count 40 --minutes 30    # the same command again goes on
    python scripts/draw_mutants.py --rooms metrics,fusion --count 10 --seed 1 --survivors

A mutant is the library with one operator, number, truth value or function (min, max...) replaced; a test that fails
kills it. All happens in a copy of the tracked files; the working tree stays as it is. Per mutant these tests run, until
one fails: those that import the changed module, other unit tests of its room (of its folder, in large rooms) and, with
--conformance, its conformance tests. If a kernel may hold the change, Python runs all kernels, which takes
no time to compile, knows no stale kernel and checks each index.

What is finished is kept in a file of JSON lines (--out). `--survivors` runs only mutants again that survived, after you
wrote tests. If a survivor computes the same as the original for every input, write "equivalent" in the place of its
verdict "survived" in that file: it no longer counts. The rate is killed (timeouts too) by all that are not equivalent.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tabulate import tabulate

ROOT = Path(__file__).parents[1]
ROOMS = (
    "metrics", "tracking", "fusion", "comms", "nn", "learn",
    "envs", "wire", "world", "bench", "attacks", "defenses", "planning", "interfaces",
)  # fmt: skip
CONFORMANCE = {
    "metrics": ("test_every_metric",),
    "tracking": ("test_every_policy",),
    "fusion": ("test_every_policy",),
    "comms": ("test_every_codec", "test_every_uplink"),
    "nn": ("test_every_fusion", "test_every_learned_policy"),
    "envs": ("test_environments",),
    "attacks": ("test_every_attack",),
    "defenses": ("test_every_defense",),
    "planning": ("test_every_planner",),
    "interfaces": ("test_every_attack", "test_every_defense", "test_every_planner"),
}
BY_FOLDER = ("nn", "learn", "world", "bench")  # large rooms, whose folders have little to do with each other
BY_COMMANDS = {"attacks": "test_*attack*.py", "interfaces": "test_*attack*.py"}
"""Tests of `tests/integration` that stand for the unit tests of a room, by the pattern of their names."""

OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult, ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
    ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
PAIRS = (
    ("min", "max"), ("minimum", "maximum"), ("fmin", "fmax"), ("argmin", "argmax"), ("amin", "amax"), ("any", "all"),
    ("floor", "ceil"), ("zeros", "ones"), ("zeros_like", "ones_like"), ("sin", "cos"),
)  # fmt: skip
FUNCTIONS = dict(PAIRS) | {b: a for a, b in PAIRS}
UNTOUCHED = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)  # what is said, not what is done


@dataclass(frozen=True)
class Mutant:
    """Replacement of bytes `start` to `end` of the file at `path`, relative to the root, on line `line`."""

    path: str
    line: int
    start: int
    end: int
    before: str
    after: str

    @property
    def room(self) -> str:
        return self.path.split("/")[1]

    def applied(self, source: bytes) -> bytes:
        return source[: self.start] + self.after.encode() + source[self.end :]


def find_mutants(path: str, source: str) -> list[Mutant]:
    """Return every mutant of a file, in the file's order. Annotations, decorators and messages stay as they are."""
    offsets = [0]
    for row in source.encode().splitlines(keepends=True):
        offsets.append(offsets[-1] + len(row))
    found = []
    for node in _expressions(ast.parse(source)):
        start = offsets[node.lineno - 1] + node.col_offset
        end = offsets[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        before = source.encode()[start:end].decode()
        found += [Mutant(path, node.lineno, start, end, before, f"({ast.unparse(each)})") for each in _replace(node)]
    return found


def _expressions(tree: ast.AST) -> Iterator[ast.expr]:
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or isinstance(child, UNTOUCHED):
                continue
            if isinstance(child, ast.expr):
                yield child
            yield from _expressions(child)


def _replace(node: ast.expr) -> Iterator[ast.expr]:
    match node:
        case ast.Compare():
            for k, op in enumerate(node.ops):
                changed = copy.deepcopy(node)
                changed.ops[k] = OPERATORS[type(op)]()  # type: ignore[call-overload]
                yield changed
        case ast.BinOp() | ast.BoolOp() if type(node.op) in OPERATORS and not _is_of_types(node):
            changed = copy.deepcopy(node)
            changed.op = OPERATORS[type(node.op)]()
            yield changed
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert()):
            yield node.operand
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
        case ast.Constant(value=float()):
            yield ast.Constant(1.5 * node.value if node.value else 0.5)
        case ast.Name(ctx=ast.Load()) if node.id in FUNCTIONS:
            yield ast.Name(FUNCTIONS[node.id])
        case ast.Attribute(ctx=ast.Load()) if node.attr in FUNCTIONS:
            yield ast.Attribute(node.value, FUNCTIONS[node.attr])


def _is_of_types(node: ast.AST) -> bool:
    """Tell unions such as `Path | None` from sets, masks and flags."""
    return "None" in (ast.unparse(each) for each in ast.iter_child_nodes(node) if isinstance(each, ast.Constant))


def draw(root: Path, room: str, count: int, seed: int) -> list[Mutant]:
    """Draw mutants of a room. The first are the same for any count, and a change of one file moves no other's draw."""
    every: list[Mutant] = []
    for path in sorted((root / "coopsim" / room).rglob("*.py")):
        every += find_mutants(str(path.relative_to(root)), path.read_text())
    return sorted(every, key=lambda each: random.Random(f"{seed} {each}").random())[:count]


def tests_of(root: Path, mutant: Mutant, conformance: bool) -> list[list[str]]:
    """List the tests that may kill a mutant, in the order in which to try."""
    module = Path(mutant.path).with_suffix("")
    parts = module.parts[1:-1] if mutant.room in BY_FOLDER else module.parts[1:2]
    unit = root / "tests" / "unit"
    dotted = ".".join(module.parts).removesuffix(".__init__")
    names = re.compile(rf"{re.escape(dotted)}\b")
    near = {path for path in unit.rglob("test_*.py") if names.search(path.read_text())}
    room = set(unit.joinpath(*parts).rglob("test_*.py")) - near
    room |= set((root / "tests" / "integration").glob(BY_COMMANDS.get(mutant.room, "none")))
    whole = [root / f"tests/conformance/{each}.py" for each in CONFORMANCE.get(mutant.room, ()) if conformance]
    stages = (sorted(near), sorted(room), whole)
    return [[str(path.relative_to(root)) for path in stage] for stage in stages if stage]


def may_be_compiled(root: Path, path: str) -> bool:
    """Tell whether a kernel may hold something of a file: its own lines, or a constant that it imports from it."""
    module = ".".join(Path(path).with_suffix("").parts).removesuffix(".__init__")
    kernels = [each.read_text() for each in (root / "coopsim").rglob("*.py") if "njit" in each.read_text()]
    return "njit" in (root / path).read_text() or any(f"from {module} import" in each for each in kernels)


class Judge:
    """Runs tests on mutants in a copy of the library, and leaves out tests that fail on the original, too."""

    def __init__(self, root: Path, kernels: Path, patience_s: float, conformance: bool = False) -> None:
        self.root, self.kernels, self.patience_s, self.conformance = root, kernels, patience_s, conformance
        self.broken: dict[bool, list[str]] = {False: [], True: []}  # by whether Python runs the kernels

    def verdict(self, mutant: Mutant) -> str:
        """Return "killed", "timeout" or "survived"."""
        interpret = may_be_compiled(self.root, mutant.path)
        for tests in tests_of(self.root, mutant, self.conformance):
            while True:
                try:
                    failed = self._run_mutant(mutant, tests, interpret)
                except subprocess.TimeoutExpired:
                    return "timeout"
                if failed is None:
                    break
                if self._run([failed], interpret) is None:
                    return "killed"
                self.broken[interpret].append(failed)
                print(f"left out, as it fails without a mutant: {failed}", flush=True)
        return "survived"

    def _run_mutant(self, mutant: Mutant, tests: Sequence[str], interpret: bool) -> str | None:
        path = self.root / mutant.path
        original = path.read_bytes()
        path.write_bytes(mutant.applied(original))
        try:
            return self._run(tests, interpret)
        finally:
            path.write_bytes(original)

    def _run(self, tests: Sequence[str], interpret: bool) -> str | None:
        """Run tests until one fails: its name, or None. Raises TimeoutExpired where they outlast the patience."""
        changes = {
            "PYTHONPATH": str(self.root), "PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1",
            "NUMBA_CACHE_DIR": str(self.kernels), "NUMBA_DISABLE_JIT": str(int(interpret)),
        }  # fmt: skip
        broken = self.broken[interpret]
        left_out = [word for name in broken for word in ("--deselect", name)]
        files = [name for name in tests if name not in broken]  # a file that cannot be read has no test to leave out
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *files, *left_out]
        if not files:
            return None
        with subprocess.Popen(command, cwd=self.root, env=os.environ | changes, start_new_session=True, text=True,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:  # fmt: skip
            try:
                said, _ = process.communicate(timeout=self.patience_s)
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        if process.returncode in (0, 5):  # 5: none is left, as those of the long check do not run here
            return None
        named = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", said, re.MULTILINE)
        return named[1] if named else tests[0]


def copy_tree(root: Path, copied: Path) -> None:
    """Copy what git tracks of a working tree, as it is now. Links stay links."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, check=True, capture_output=True, text=True).stdout
    for name in listed.split("\0")[:-1]:
        if (root / name).exists():
            (copied / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, copied / name, follow_symlinks=False)


def read_rows(out: Path) -> dict[Mutant, str]:
    """Read the verdicts; the last on a mutant holds."""
    verdicts = {}
    for row in map(json.loads, out.read_text().splitlines() if out.exists() else []):
        verdict = row.pop("verdict")
        verdicts[Mutant(**row)] = verdict
    return verdicts


def table(mutants: Sequence[Mutant], verdicts: dict[Mutant, str]) -> str:
    """Lay out the counts by room, and the survivors."""
    rows = []
    for room in (*dict.fromkeys(mutant.room for mutant in mutants), "all"):
        seen = Counter(verdicts[each] for each in mutants if each in verdicts and room in (each.room, "all"))
        dead, counted = seen["killed"] + seen["timeout"], seen.total() - seen["equivalent"]
        rate = f"{100 * dead / counted:.0f} %" if counted else ""
        rows.append([room, *(seen[each] for each in ("killed", "timeout", "survived", "equivalent")), rate])
    survivors = [f"{m.path}:{m.line}: {m.before} -> {m.after}" for m in mutants if verdicts.get(m) == "survived"]
    heads = ["room", "killed", "timeout", "survived", "equivalent", "rate"]
    return "\n".join([tabulate(rows, heads, tablefmt="github"), *survivors])


def main(typed: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", default=",".join(ROOMS), help="folders of coopsim/ (default: %(default)s)")
    parser.add_argument("--count", type=int, default=10, help="mutants of each room (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="which mutants are drawn (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no mutant after this time")
    parser.add_argument("--patience", type=float, default=15, help="minutes that tests may take (default: %(default)s)")
    parser.add_argument("--conformance", action="store_true", help="try conformance tests, too, which takes long")
    parser.add_argument("--survivors", action="store_true", help="run only those again that survived")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "mutants.jsonl", help="default: %(default)s")
    asked = parser.parse_args(typed)
    mutants = [each for room in asked.rooms.split(",") for each in draw(ROOT, room, asked.count, asked.seed)]
    if not mutants:
        parser.error(f"--rooms {asked.rooms}: no such folders of coopsim/, or nothing in them to change")
    verdicts = read_rows(asked.out)
    due = [each for each in mutants if (verdicts.get(each) == "survived" if asked.survivors else each not in verdicts)]
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    ends_s = time.monotonic() + 60 * asked.minutes
    with tempfile.TemporaryDirectory() as folder:
        copied = Path(folder) / "copy"
        copy_tree(ROOT, copied)
        judge = Judge(copied, Path(folder) / "kernels", 60 * asked.patience, asked.conformance)
        for mutant in due:
            if time.monotonic() > ends_s:
                break
            verdicts[mutant] = judge.verdict(mutant)
            with asked.out.open("a") as lines:
                lines.write(json.dumps(asdict(mutant) | {"verdict": verdicts[mutant]}) + "\n")
            print(f"{verdicts[mutant]}: {mutant.path}:{mutant.line}: {mutant.before} -> {mutant.after}", flush=True)
    print(table(mutants, verdicts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
