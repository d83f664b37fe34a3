"""How many small errors in a module the tests detect: the mutation kill rate.

    python benchmarks/mutation.py massprop_cli/conclude/verdict.py tests/conclude tests/test_flow.py --count 20 --seed 1

A mutant changes one place: a comparison, an arithmetic operator, a number, a condition or a sign. Each runs in a copy of the committed
tree, against the named tests, until the first failure.
"""

import argparse
import ast
import copy
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

_PAIRS: tuple[tuple[type[ast.cmpop], type[ast.cmpop]], ...] = (
    (ast.Lt, ast.GtE),
    (ast.Gt, ast.LtE),
    (ast.Eq, ast.NotEq),
    (ast.Is, ast.IsNot),
)
COMPARE = dict(_PAIRS) | {other: one for one, other in _PAIRS}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.BitOr: ast.BitAnd, ast.BitAnd: ast.BitOr,
}  # fmt: skip
TIMEOUT_S = 900.0


def places(tree: ast.Module) -> list[int]:
    """Positions, in the order of ``ast.walk``, of the nodes that a mutant may change; annotations and docstrings are none."""
    skipped = {id(inner) for node in ast.walk(tree) for part in _unread(node) for inner in ast.walk(part)}
    return [i for i, node in enumerate(ast.walk(tree)) if id(node) not in skipped and _changed(copy.deepcopy(node))]


def _unread(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.AnnAssign | ast.arg) and node.annotation is not None:
        yield node.annotation
    if isinstance(node, ast.FunctionDef) and node.returns is not None:
        yield node.returns
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
        yield node


def _changed(node: ast.AST) -> bool:
    """Change the node in place; False for a kind of node that no mutant changes."""
    if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARE:
        node.ops[0] = COMPARE[type(node.ops[0])]()
    elif isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        node.op = ARITHMETIC[type(node.op)]()
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        node.value = not node.value
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        node.value = node.value * 2 + 1
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        node.op = ast.UAdd()
    elif isinstance(node, ast.If | ast.IfExp):
        node.test = ast.UnaryOp(ast.Not(), node.test)
    elif isinstance(node, ast.BoolOp):
        node.op = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
    else:
        return False
    return True


def mutant(text: str, place: int) -> tuple[int, str]:
    """Line and text of the module with one place changed."""
    tree = ast.parse(text)
    node = next(node for i, node in enumerate(ast.walk(tree)) if i == place)
    line = getattr(node, "lineno", 0)
    _changed(node)
    return line, ast.unparse(ast.fix_missing_locations(tree))


def killed(folder: Path, module: str, text: str, tests: list[str]) -> bool:
    """Whether the tests fail in a copy of the tree that holds the mutant."""
    path = folder / module
    before = path.read_text()
    path.write_text(text)
    environment = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
    try:
        return subprocess.run(command, cwd=folder, env=environment, capture_output=True, timeout=TIMEOUT_S).returncode != 0
    except subprocess.TimeoutExpired:
        return True
    finally:
        path.write_text(before)


def main() -> None:
    """Print each survivor, then the rate."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("module")
    parser.add_argument("tests", nargs="+")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    root = Path(__file__).resolve().parent.parent
    text = (root / options.module).read_text()
    chosen = places(ast.parse(text))
    random.Random(options.seed).shuffle(chosen)
    chosen = sorted(chosen[: options.count])
    with tempfile.TemporaryDirectory() as kept, ThreadPoolExecutor(options.jobs) as pool:
        free = []
        for job in range(options.jobs):
            free.append(Path(kept) / str(job))
            subprocess.run(["git", "clone", "-q", str(root), str(free[-1])], check=True)
            for built in (root / "massprop_cli" / "kernel").glob("*.so"):
                (free[-1] / "massprop_cli" / "kernel" / built.name).write_bytes(built.read_bytes())

        def one(place: int) -> bool:
            folder, (line, changed) = free.pop(), mutant(text, place)
            try:
                found = killed(folder, options.module, changed, options.tests)
            finally:
                free.append(folder)
            if not found:
                print(f"survives: {options.module}:{line}", flush=True)
            return found

        found = list(pool.map(one, chosen))
    print(f"{options.module}: {sum(found)} of {len(found)} mutants are killed")


if __name__ == "__main__":
    main()
