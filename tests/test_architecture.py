"""Do imports only run down the floors of docs/house.md?"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "bulgefit"

#: Rooms of the same floor do not import each other; the ground is one room.
FLOORS = {
    "cli": 8,
    "report": 7,
    "gap": 6,
    "trial": 6,
    "fitting": 5,
    "model": 4,
    "effects": 3,
    "fem": 2,
    "dic": 2,
    "parallel": 1,
    "files": 1,
    "shown": 1,
    "errors": 1,
}
GROUND = 1

#: The package itself gives out the public names and starts the command line.
ROOF = ("__init__", "__main__")

MODULES = sorted(path.relative_to(SOURCE).as_posix() for path in SOURCE.rglob("*.py"))


def room_of(module: str) -> str:
    """The room of a file, such as fem for fem/mesh.py."""
    return module.split("/")[0].removesuffix(".py")


def imported(tree: ast.AST, module: str) -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything of ours that a file imports, wherever it stands."""
    here = ["bulgefit", *module.removesuffix(".py").split("/")[:-1]]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            start = here[: len(here) + 1 - node.level] if node.level else []
            base = [*start, *(node.module.split(".") if node.module else [])]
            found = [".".join([*base, alias.name]) for alias in node.names]
        else:
            continue
        yield from ((node.lineno, name) for name in found if name.split(".")[0] == "bulgefit")


def complaints(tree: ast.AST, module: str) -> list[str]:
    """What runs up or sideways in a file."""
    room = room_of(module)
    if room in ROOF:
        return []
    found = []
    for line, name in imported(tree, module):
        parts = name.split(".")
        if len(parts) == 1:
            if room != "cli":
                found.append(f"{module}:{line} imports the whole package")
        elif parts[1] not in FLOORS:
            found.append(f"{module}:{line} takes the public name {name}, not its home")
        elif parts[1] != room:
            above, below = FLOORS[room], FLOORS[parts[1]]
            if not (above > below or above == below == GROUND):
                found.append(f"{module}:{line} imports {name}, from floor {above} to {below}")
    return found


@pytest.mark.parametrize("module", MODULES)
def test_imports_run_down(module):
    tree = ast.parse((SOURCE / module).read_text(encoding="utf-8"))
    assert complaints(tree, module) == []


def test_every_room_has_a_floor():
    rooms = {room_of(module) for module in MODULES}
    assert rooms - {*ROOF} <= FLOORS.keys()


def test_the_plan_tells_the_same():
    """docs/house.md lists the rooms with these floors."""
    text = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d) \| `(\w+)(?:/|\.py)`", text, flags=re.MULTILINE)
    assert {room: int(floor) for floor, room in rows} == FLOORS


@pytest.mark.parametrize(
    ("module", "line", "bad"),
    [
        ("fem/a.py", "from bulgefit.dic import read_test", True),
        ("fem/a.py", "from bulgefit.fem.mesh import disc", False),
        ("fem/a.py", "from .mesh import disc", False),
        ("fem/a.py", "from ..model import parameters", True),
        ("fem/a.py", "from .. import model", True),
        ("dic/a.py", "import bulgefit.errors", False),
        ("dic/a.py", "import bulgefit", True),
        ("dic/a.py", "def f():\n    from bulgefit import fitting", True),
        ("fitting/a.py", "from bulgefit import fit", True),
        ("fitting/a.py", "from bulgefit.report import fields", True),
        ("files.py", "from bulgefit.errors import InputError", False),
        ("errors.py", "from bulgefit.fem import mesh", True),
        ("cli/a.py", "import bulgefit, numpy", False),
        ("report/a.py", "import numpy.linalg", False),
    ],
)
def test_the_rule_itself(module, line, bad):
    assert bool(complaints(ast.parse(line), module)) is bad
