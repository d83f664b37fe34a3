"""Which package may import which: the code flows from inputs to reports, and nothing turns back."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import massprop_cli
from tests.source import nodes

ROOMS = Path(massprop_cli.__file__).parent
FLOW = (
    *("base", "kernel", "inputs", "prepare", "errorparameters", "model", "estimate", "diagnosis", "conclude", "flow", "result", "report"),
    *("job", "check", "combine", "balance", "predict", "campaign", "plan", "export", "live", "schemas", "api", "cli"),
)
"""Each imports those before it alone, and itself."""
TESTBED = ("base", "inputs", "testbed")
"""What the simulator may import: it shares no equations with the estimator."""
FLYING = ("plan", "check", "combine", "schemas", "cli")
"""What may import the simulator."""
FILES = [file for file in sorted(ROOMS.rglob("*.py")) if file.name not in ("__init__.py", "__main__.py") or file.parent != ROOMS]


def room(module: str) -> str:
    """The package, or the module beside the packages, that a dotted name is in."""
    return module.split(".")[1]


def imported(file: Path) -> set[str]:
    """The rooms that a file imports from; names of the package itself (the ten quantities, the version) are everyone's."""
    found = set()
    for node in nodes(file):
        if isinstance(node, ast.Import):
            found |= {room(alias.name) for alias in node.names if alias.name.startswith("massprop_cli.")}
        elif isinstance(node, ast.ImportFrom) and node.module == "massprop_cli":
            found |= {alias.name for alias in node.names if (ROOMS / alias.name).is_dir() or (ROOMS / f"{alias.name}.py").exists()}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("massprop_cli."):
            found.add(room(node.module or ""))
    return found


def test_every_room_has_a_place_in_the_flow() -> None:
    rooms = {file.relative_to(ROOMS).parts[0].removesuffix(".py") for file in FILES}
    assert rooms <= {*FLOW, "testbed"}


def allowed(file: Path) -> set[str]:
    """The rooms that a file may import from."""
    own = file.relative_to(ROOMS).parts[0].removesuffix(".py")
    return {*TESTBED} if own == "testbed" else {*FLOW[: FLOW.index(own) + 1]} | ({"testbed"} if own in FLYING else set())


def test_imports_go_with_the_flow() -> None:
    against = {file.relative_to(ROOMS).as_posix(): imported(file) - allowed(file) for file in FILES}
    assert {name: rooms for name, rooms in against.items() if rooms} == {}


def module(file: Path) -> str:
    """Its dotted name."""
    return ".".join(file.relative_to(ROOMS.parent).with_suffix("").parts).removesuffix(".__init__")


def test_no_file_is_imported_by_what_it_imports() -> None:
    """Also where that is put off until it is needed."""
    names = {module(file) for file in FILES}
    graph: dict[str, set[str]] = {}
    for file in FILES:
        froms = [node for node in nodes(file) if isinstance(node, ast.ImportFrom)]
        said = {(node.module or "", f"{node.module}.{alias.name}") for node in froms for alias in node.names}
        graph[module(file)] = {whole if whole in names else package for package, whole in said} & names
    TopologicalSorter(graph).prepare()


LONGEST = 50
"""Lines of a function, but for commands, whose options are declared in it."""


def functions(file: Path) -> dict[str, int]:
    """Length of each function that is no command."""
    each = [node for node in nodes(file) if isinstance(node, ast.FunctionDef)]
    return {node.name: (node.end_lineno or 0) - node.lineno + 1 for node in each if not (file.parent.name == "cli" and node.decorator_list)}


def test_no_function_is_longer_than_a_page() -> None:
    assert {f"{file.name}: {name}": lines for file in FILES for name, lines in functions(file).items() if lines > LONGEST} == {}
