"""What draws places calls nothing whose last bit differs between processors."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import coopsim.world

WORLD = Path(coopsim.world.__file__).parent
ROOMS = ("custom", "furniture", "models", "places", "relief", "towns")
DRAWING = [
    *(path for room in ROOMS for path in sorted((WORLD / room).rglob("*.py"))),
    WORLD / "traffic" / "traffic.py",
    *sorted((WORLD.parents[1] / "scripts" / "actor_shapes").glob("*.py")),
]

BY_EXACT = {"sin", "cos", "tan", "arctan", "arctan2", "atan", "atan2", "arcsin", "asin", "arccos", "acos", "hypot"}
BY_EXACT |= {"dist", "dot", "vdot", "inner", "matmul", "einsum", "tensordot", "linalg"}
IF_SETTLED = {"exp", "expm1", "exp2", "log", "log1p", "log2", "log10", "cbrt", "pow", "power", "sinh", "cosh", "tanh"}
DRAWN = {"normal", "standard_normal", "exponential", "gamma", "beta", "lognormal", "poisson", "binomial", "triangular"}


def inexact(source: str) -> list[str]:
    """Return the calls and operators in a module that may differ in the last bit from processor to processor."""
    tree = ast.parse(source)
    settled = {id(inner) for node in ast.walk(tree) if _is_settling(node) for inner in ast.walk(node)}
    return [f"{ast.unparse(node)}" for node in ast.walk(tree) if _is_inexact(node, id(node) in settled)]


def _is_settling(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "exact.settled"


def _is_whole(node: ast.AST) -> bool:
    node = node.operand if isinstance(node, ast.UnaryOp) else node
    return isinstance(node, ast.Constant) and isinstance(node.value, int)


def _is_inexact(node: ast.AST, is_settled: bool) -> bool:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return not is_settled and not _is_whole(node.left)  # the C library's power, whose last bit may differ
    if isinstance(node, ast.MatMult):
        return True
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "argsort":
        return not any(each.arg == "kind" and ast.unparse(each.value) == "'stable'" for each in node.keywords)
    if not isinstance(node, ast.Attribute):
        return False
    if ast.unparse(node.value) in ("np", "math"):
        return node.attr in BY_EXACT or (node.attr in IF_SETTLED and not is_settled)
    return node.attr in {"dot", *DRAWN} and ast.unparse(node.value) != "exact" and not is_settled


@pytest.mark.parametrize("path", DRAWING, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_no_decision_hangs_on_the_last_bit_of_a_processor(path: Path) -> None:
    assert inexact(path.read_text()) == [], "use coopsim.geometry.exact"


@pytest.mark.parametrize(
    "code",
    [
        "a @ b",
        "a.dot(b)",
        "np.linalg.norm(a)",
        "np.hypot(a, b)",
        "math.sin(a)",
        "a**0.5",
        "a**2",
        "a ** -b",
        "np.argsort(a)",
        "np.exp(a)",
        "rng.normal()",
    ],
)
def test_what_is_inexact_is_found(code: str) -> None:
    assert len(inexact(code)) == 1


def test_what_is_exact_is_accepted() -> None:
    code = "exact.settled(np.exp(a) ** 0.5); exact.dot(a, b); 2**62; (-1) ** a; np.square(a); np.sqrt(a)"
    code += "; np.argsort(a, kind='stable')"
    assert inexact(code) == []
