"""The house rules that code can check: who imports whom, what runs without which packages."""

from __future__ import annotations

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest

import obsdesign
from obsdesign.kinds import KINDS

ROOT = Path(__file__).parent.parent
SOLVERS = ("cvxpy", "clarabel", "casadi", "highspy", "scipy.optimize", "scipy.signal")
FILES = sorted([*(ROOT / "lmi").rglob("*.py"), *(ROOT / "obsdesign").rglob("*.py")])


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@functools.cache
def imported(path: Path) -> set[str]:
    """Absolute names imported anywhere in a file, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            assert node.level == 0, f"{path}: relative import"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def uses(path: Path, package: str) -> bool:
    return any(name == package or name.startswith(package + ".") for name in imported(path))


def outside(path: Path, allowed: tuple[str, ...]) -> set[str]:
    """Imports of a file that are neither the standard library nor on the list."""
    known = set(sys.stdlib_module_names) | {"__future__"}
    return {
        name
        for name in imported(path)
        if name.split(".")[0] not in known
        and not any(name == entry or name.startswith(entry + ".") for entry in allowed)
    }


@pytest.mark.parametrize("path", FILES, ids=module)
def test_packages_live_where_they_belong(path: Path) -> None:
    name = module(path)
    if name.startswith("lmi"):
        assert not uses(path, "obsdesign"), "lmi has never heard of a plant"
    only = {
        "flint": ("lmi.arithmetic.balls",),
        "highspy": ("lmi.find.linear_program",),
        "matplotlib": ("obsdesign.pages.plotting", "obsdesign.notebook"),
        "casadi": ("obsdesign.synthesis",),
        "cvxpy": ("lmi.find", "obsdesign.synthesis"),
        "click": ("obsdesign.cli",),
        "joblib": ("obsdesign.studies.sweep",),
        "distributed": ("obsdesign.studies.sweep",),
        "control": ("obsdesign.interop",),
        "pandas": ("obsdesign.interop", "obsdesign.notebook"),
        "marimo": ("obsdesign.explore.page",),
        "tomlkit": ("obsdesign.explore",),
        "jsonschema": ("obsdesign.problem", "obsdesign.cli"),
    }
    for package, places in only.items():
        if uses(path, package):
            assert name.startswith(places), f"{package} is imported by {name}"


LIGHT = (
    "numpy", "lmi.arithmetic.exponential", "lmi.arithmetic.enclosure", "lmi.arithmetic.units", "lmi.arithmetic.arrays",
    "lmi.arithmetic.spectrum", "lmi.memory",
)  # fmt: skip


@pytest.mark.parametrize(
    ("prefix", "allowed"),
    [
        ("obsdesign.equations", (*LIGHT, "obsdesign.equations", "obsdesign.column_names")),
        ("obsdesign.output_files", ("obsdesign.errors",)),
        ("obsdesign.input_files", ("obsdesign.errors",)),
        ("obsdesign.entries", (*LIGHT, "obsdesign.errors")),
        ("obsdesign.document", (*LIGHT, "obsdesign.output_files", "obsdesign.html_table")),
        ("obsdesign.html_table", ()),
        (
            "obsdesign.design_file",
            (*LIGHT, "obsdesign.document", "obsdesign.errors", "obsdesign.entries",
             "obsdesign.input_files"),
        ),
        ("obsdesign.errors", ()),
        ("obsdesign.column_names", ()),
        ("obsdesign.kinds", ("obsdesign.errors",)),
        (
            "obsdesign.runtime",
            (*LIGHT, "obsdesign.runtime", "obsdesign.equations", "obsdesign.document",
             "obsdesign.design_file", "obsdesign.entries", "obsdesign.errors",
             "obsdesign.input_files", "obsdesign.kinds", "obsdesign.column_names"),
        ),
    ],
)  # fmt: skip
def test_light_layers_import_nothing_heavy(prefix: str, allowed: tuple[str, ...]) -> None:
    files = [path for path in FILES if (module(path) + ".").startswith(prefix + ".")]
    assert files
    for path in files:
        assert not outside(path, allowed), module(path)


# from the top down; rooms on one line do not import each other
LEVELS = (
    ("__main__",),
    ("cli",),
    ("explore",),
    ("checker",),  # no one imports it, and it imports nothing
    ("notebook",),
    ("pages",),
    ("studies",),
    ("bundle", "workflow"),
    ("candidate_choice",),
    ("synthesis", "verification"),
    ("analysis", "data", "interop", "export"),
    ("runtime", "problem"),
    ("design_file",),
    ("document",),
    ("input_files", "output_files", "entries", "equations"),
    ("kinds", "column_names"),
    ("errors", "version", "html_table"),
)
LEVEL = {room: level for level, rooms in enumerate(LEVELS) for room in rooms}


def room(name: str) -> str:
    """The folder, or the loose module, of a name inside of obsdesign."""
    return name.split(".")[1]


@pytest.mark.parametrize(
    "path", [path for path in FILES if module(path).startswith("obsdesign.")], ids=module
)
def test_rooms_look_down_only(path: Path) -> None:
    here = room(module(path))
    for name in imported(path):
        if name.startswith("obsdesign.") and room(name) in LEVEL and room(name) != here:
            assert LEVEL[room(name)] > LEVEL[here], f"{module(path)} imports {name}"


def test_every_room_has_a_level() -> None:
    names = {module(path) for path in FILES if module(path).startswith("obsdesign.")}
    assert {room(name) for name in names} == set(LEVEL)


@pytest.mark.parametrize("layer", ["equations", "synthesis", "verification", "runtime"])
def test_no_kind_imports_another(layer: str) -> None:
    for kind in KINDS:
        for path in (ROOT / "obsdesign" / layer / kind).rglob("*.py"):
            for other in set(KINDS) - {kind}:
                assert not uses(path, f"obsdesign.{layer}.{other}"), module(path)


PROVING = ("arithmetic", "prove", "refute", "rank", "bounds")


def test_provers_import_no_finder_and_no_solver() -> None:
    files = [path for folder in PROVING for path in (ROOT / "lmi" / folder).rglob("*.py")]
    rooms = [ROOT / "obsdesign" / name for name in ("verification", "analysis")]
    for path in (*files, *(path for folder in rooms for path in folder.rglob("*.py"))):
        for name in (*SOLVERS, "lmi.find", "lmi.decide"):
            assert not uses(path, name), f"{module(path)} imports {name}"


def module_level_names(tree: ast.Module) -> set[str]:
    """Names that a module binds outside of functions and classes."""
    targets = [
        target
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
    ]
    return {
        name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
    }


LAYERS = ("equations", "analysis", "synthesis", "verification", "runtime")
CHANGING = {
    "add", "append", "appendleft", "clear", "discard", "extend", "insert", "pop", "popitem",
    "popleft", "remove", "reverse", "setdefault", "sort", "update",
}  # fmt: skip


def changed_names(function: ast.AST) -> set[str]:
    """Names whose value a function changes in place, and that it does not bind itself."""
    changed, bound = set[str](), set[str]()
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound.add(node.id)
        if isinstance(node, ast.arg):
            bound.add(node.arg)
        owner: ast.AST | None = None
        if isinstance(node, ast.Subscript | ast.Attribute) and not isinstance(node.ctx, ast.Load):
            owner = node.value
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value if node.func.attr in CHANGING else None
        if isinstance(owner, ast.Name):
            changed.add(owner.id)
    return changed - bound


@pytest.mark.parametrize("path", FILES, ids=module)
def test_no_module_keeps_state(path: Path) -> None:
    """What a search may take, and what it remarks, are arguments and results."""
    assert not uses(path, "contextvars")
    tree = parsed(path)
    names = module_level_names(tree)
    for node in ast.walk(tree):
        assert not isinstance(node, ast.Global), f"{module(path)} has a global variable"
        if isinstance(node, ast.FunctionDef):
            assert not names & changed_names(node), f"{module(path)}: {node.name}"


# where `Any` stands: under a name and with its reason, or where untyped things come in and go out
ANY = {
    "lmi.arithmetic.arrays": "exact-or-float arrays, and values of files",
    "lmi.find.constrained": "expressions of CVXPY",
    "obsdesign": "names that are imported when they are first used",
    "obsdesign.checker.check_design": "JSON of a design, read by what needs nothing else",
    "obsdesign.checker.check_events": "the same",
    "obsdesign.checker.check_gains": "the same",
    "obsdesign.checker.check_sets": "the same",
    "obsdesign.checker.check_uncertain": "the same",
    "obsdesign.checker.check_widths": "the same",
    "obsdesign.equations.stored": "declarations of fields",
    "obsdesign.input_files": "what json reads, where numpy is not loaded",
    "obsdesign.interop.export": "models of python-control",
    "obsdesign.interop.frames": "tables of pandas",
    "obsdesign.interop.state_space": "models of scipy and python-control",
    "obsdesign.runtime.base": "states, of which each kind has its own",
    "obsdesign.runtime.columns": "events, of which each kind has its own",
    "obsdesign.runtime.stored_state": "annotations of states, which say what may be read",
    "obsdesign.studies.sweep.workers": "the client of Dask",
    "obsdesign.synthesis.finite_time.period_program": "expressions of CasADi",
    "obsdesign.synthesis.impulsive_input.exponent_program": "expressions of CasADi",
}


def has_any(tree: ast.AST) -> bool:
    """Does a file use `Any`?"""
    return any(
        (isinstance(node, ast.Name) and node.id == "Any")
        or (isinstance(node, ast.Attribute) and node.attr == "Any")
        for node in ast.walk(tree)
    )


def test_any_stands_at_borders_alone() -> None:
    """Elsewhere a value has a type: a table of a file is `Entries` until a dataclass reads it."""
    using = {module(path) for path in FILES if has_any(parsed(path))}
    assert using == set(ANY)


@pytest.mark.parametrize("text", ["x: Any = 1", "x: dict[str, typing.Any]", "Table = list[Any]"])
def test_any_is_recognised(text: str) -> None:
    assert has_any(ast.parse(text))
    assert not has_any(ast.parse(text.replace("Any", "Value")))


def test_searches_and_proofs_read_no_clock() -> None:
    """Their own limits are counted in work; only a stated total ends them by time."""
    rooms = [ROOT / "lmi", *(ROOT / "obsdesign" / name for name in LAYERS)]
    clocked = {module(path) for room in rooms for path in room.rglob("*.py") if uses(path, "time")}
    assert clocked == {"lmi.time_budget"}


def test_state_of_a_module_is_seen() -> None:
    """The twin: a module whose function writes into a list of the module."""
    tree = ast.parse("KNOWN: list[int] = []\ndef note(x):\n    KNOWN.append(x)\n")
    assert module_level_names(tree) & changed_names(tree.body[1]) == {"KNOWN"}


def test_package_roots_are_light() -> None:
    code = (
        "import sys, obsdesign, lmi, obsdesign.runtime;"
        "heavy = {'scipy', 'cvxpy', 'clarabel', 'flint', 'casadi', 'matplotlib', 'jsonschema'};"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_verify_and_run_do_without_slow_imports(academic_design: Path, tmp_path: Path) -> None:
    data = tmp_path / "data.csv"
    data.write_text("t,y1,jump\n0,1,0\n0.1,0.9,0\n")
    verify = ["verify", str(academic_design)]
    run = ["run", str(academic_design), str(data), "--initial=-2,2,-2,2", "-o", f"{data}.out"]
    for words, further in ((verify, ()), (run, ("rich", "flint"))):
        heavy = {"scipy", "cvxpy", "clarabel", "casadi", "matplotlib", "jsonschema", *further}
        code = (
            f"import sys; sys.argv = ['obsdesign', *{words!r}]\n"
            "from obsdesign.cli.main import main\n"
            "try: main()\n"
            "except SystemExit as end: assert not end.code, end.code\n"
            f"assert not {heavy!r} & set(sys.modules), {heavy!r} & set(sys.modules)\n"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_the_help_and_the_version_do_without_numpy() -> None:
    for words in (["--help"], ["design", "--help"], ["--version"]):
        code = f"sys.argv = ['obsdesign', *{words}]; from obsdesign.cli.main import main; main()"
        done = run_blocked(("numpy", "rich", "scipy", "flint"), code)
        assert done.returncode == 0, done.stderr
        assert "obsdesign" in done.stdout
    # the twin: an answer needs them
    assert "blocked" in run_blocked(("numpy",), "import obsdesign.cli.answers").stderr


BLOCKER = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if any(name == b or name.startswith(b + ".") for b in {blocked!r}):
            raise ImportError("blocked: " + name)
sys.meta_path.insert(0, Blocked())
"""


def run_blocked(blocked: tuple[str, ...], code: str) -> subprocess.CompletedProcess[str]:
    script = BLOCKER.format(blocked=blocked) + code
    return subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )


def test_verify_runs_without_any_solver(academic_design: Path) -> None:
    code = f"""
import obsdesign
outcome = obsdesign.verify(obsdesign.load_design({str(academic_design)!r}))
assert outcome.verdict == "proved", outcome.claims
"""
    done = run_blocked(SOLVERS, code)
    assert done.returncode == 0, done.stderr
    impulsive = academic_design.parent / "impulsive.json"
    examples = ROOT / "examples"
    obsdesign.design(obsdesign.load_problem(examples / "medina_spline.toml")).save(impulsive)
    done = run_blocked(SOLVERS, code.replace(str(academic_design), str(impulsive)))
    assert done.returncode == 0, done.stderr
    # the twin: the blocker really blocks, since finding P needs the solver
    finding = run_blocked(SOLVERS, "import lmi.find.semidefinite as s; import clarabel")
    assert "blocked: clarabel" in finding.stderr


def test_runtime_runs_with_numpy_alone(academic_design: Path) -> None:
    blocked = (
        *SOLVERS, "scipy", "flint", "matplotlib", "jsonschema", "click", "rich", "hypothesis",
    )  # fmt: skip
    code = f"""
before = set(sys.modules)  # what the interpreter of this machine loads by itself
from obsdesign.runtime import Sample, load
observer = load({str(academic_design)!r})
state = observer.init(t=0.0, lower=[0, 0], upper=[2, 2])
for k in range(1, 50):
    state, estimate = observer.step(state, Sample(k / 10, y=[1.0], jump=k == 20))
assert (estimate.lower < estimate.upper).all()
loaded = set(sys.modules) - before
third_party = set(m.split(".")[0] for m in loaded) - set(sys.stdlib_module_names)
print(sorted(m for m in third_party if not m.startswith("_")))
"""
    done = run_blocked(blocked, code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "['lmi', 'numpy', 'obsdesign']"
    impulsive = academic_design.parent / "impulsive.json"
    problem = obsdesign.load_problem(ROOT / "examples" / "medina_spline.toml")
    obsdesign.design(problem).save(impulsive)
    code = f"""
from obsdesign.runtime import Sample, load
observer = load({str(impulsive)!r})
state = observer.init(t=0.0)
for k in range(1, 9):
    state, estimate = observer.step(state, Sample(k / 2, y=[1.0], w=[0.0], jump=True))
assert estimate.status == "ok"
"""
    done = run_blocked(blocked, code)
    assert done.returncode == 0, done.stderr
