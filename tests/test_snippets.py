"""Every command and every snippet of the documents is one that the program takes: what their tests
do not execute is parsed and checked here.

| what documents show | here | executed by |
| --- | --- | --- |
| commands in blocks | parsed; scenes load, and have what is named | `test_documents.py`, pages of EXECUTED; others take minutes |
| commands of benchmarks | file and options exist | nothing: they run for minutes to hours |
| TOML | joined with a scene that has its names, loaded and checked | `test_target_files.py`, `test_includes.py`, `test_examples.py`: IN_OTHER_TESTS |
| Python | compiled | `test_python_document.py`, `test_mechanism_document.py`, `test_documents.py`, but for NOT_EXECUTED |
"""

import ast
import functools
import operator
import re
import shlex
import shutil
import tomllib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest
import typer

from headstock.app.command_line import app
from headstock.app.commands.options import split_list
from headstock.scene.building.loader import build_scene, load_scene, read_tables
from headstock.scene.reading.findings import Findings, SceneError
from headstock.scene.reading.names import NAMES
from headstock.scene.scene import Scene
from headstock.validation.case_registry import _select_cases

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "environment/README.md",
    *sorted(
        f"{folder}/{path.name}"
        for folder in ("benchmarks", "docs", "validation")
        for path in (ROOT / folder).glob("*.md")
    ),
]
BLOCK = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
INCLUDED = re.compile(r'^--8<-- "(.*)"$', re.MULTILINE)
INDENTED = re.compile(r"^    (\S.*)$", re.MULTILINE)
INLINE = re.compile(r"`([^`\n]+)`")
# what begins a command of the program, behind variables and programs that start others
STARTED = re.compile(
    r"(?:[A-Z_]+=\S+ |/usr/bin/time -v |srun \S+ |mpirun --hostfile HOSTS |exec \S*/)*(?:\./)?headstock(?: |$)"
)
# words that the launcher knows and the program does not
LAUNCHER = {"test", "exec", "docs", "python", "notebook", "release-check", "COMMAND", "--with"}
IN_CHECKOUT = r"(?:tests|benchmarks|docs|machines|environment)/\S+"
OF_SCENES = r"(?:machines|tests)/[^{*]+$"
# in blocks beside commands of the program
OTHER_PROGRAMS = {"cat", "echo", "mkdir", "export"}
# placeholders that an option would refuse
VALUES = {"N": "2", "HZ": "100 Hz"}
NOT_EXECUTED = {
    ("docs/mesh_files.md", 0): "reads a file that only `export --mesh` with XDMF arrays leaves; "
    "tests/meshing/export reads it the same way"
}
DATA = "tests/data/documented.toml"
THREE_AXIS, TRIPTEOR = "machines/three_axis.toml", "machines/tripteor.toml"
CANTILEVER = "machines/cantilever.toml"


class Base(NamedTuple):
    """A scene that a snippet of TOML completes, a variant of it, and keys that the snippet
    replaces.
    """

    scene: str
    variant: str | None = None
    without: tuple[str, ...] = ()


BLOCK_OF_TRIPTEOR = ("analyses.contouring.side", "analyses.contouring.at")
TURNING = "tests/data/turning_arm.toml"
OWN_CONTROLLER = Base(
    THREE_AXIS,
    "controlled",
    tuple(f"drives.X.{key}" for key in ("velocity_gain", "integral_time", "sampling")),
)
WITHOUT_Y = Base(DATA, without=("axes.Y", "joints.y_guide"))
# a snippet has to complete one of its page's scenes
BASES = {
    "docs/accuracy.md": [Base(CANTILEVER)],
    "docs/catalogue.md": [Base(DATA, without=("axes.X", "joints.x_guide"))],
    "docs/comparing.md": [Base(THREE_AXIS)],
    "docs/contouring.md": [
        Base(TRIPTEOR),
        Base(TRIPTEOR, without=BLOCK_OF_TRIPTEOR),
        Base(TRIPTEOR, "elastic_legs"),
    ],
    "docs/cutting_coefficients.md": [Base(THREE_AXIS, without=("analyses.lobes",))],
    "docs/drives.md": [
        Base(THREE_AXIS, "controlled"),
        Base(TRIPTEOR, "lumped+controlled"),
        OWN_CONTROLLER,
        Base(TURNING),
    ],
    "docs/frequency_response.md": [Base(DATA), Base(CANTILEVER, without=("analyses.modal.count",))],
    "docs/geometric_errors.md": [
        Base(DATA),
        Base(THREE_AXIS, "uneven", without=tuple(f"axes.{axis}.limits" for axis in "XYZ")),
        Base(THREE_AXIS, "controlled"),
        Base(TRIPTEOR, "lumped"),
    ],
    "docs/guideways.md": [Base(DATA), Base(DATA, without=("joints.x_guide",))],
    "docs/lobes.md": [Base(THREE_AXIS)],
    "docs/path_analysis.md": [
        Base(THREE_AXIS),
        Base(TRIPTEOR),
        Base("tests/data/turning_arm.toml", without=("analyses.path",)),
    ],
    # each table with what it belongs to
    "docs/scene_reference.md": [
        Base(DATA),
        Base(DATA, without=("joints.x_guide",)),
        Base(DATA, without=("axes.X", "joints.x_guide")),
        Base(THREE_AXIS),
        Base(THREE_AXIS, "controlled"),
        OWN_CONTROLLER,
        Base(THREE_AXIS, "milling"),
        Base(TRIPTEOR, "lumped"),
        Base(CANTILEVER),
    ],
    "docs/short_scenes.md": [Base(DATA), WITHOUT_Y],
    "docs/studies.md": [Base(CANTILEVER), Base(CANTILEVER, without=("studies.h",))],
    "docs/sweeps.md": [Base(THREE_AXIS, "rails")],
}
OTHER_PAGES = [Base(DATA), Base(CANTILEVER), Base(THREE_AXIS)]
# lines of files that are no scenes, and of scenes in several files
IN_OTHER_TESTS = ("[cases.R]", "include = [", "[components.spindle]", 'name = "Table on a bed"')


def blocks(page: str, *kinds: str) -> list[str]:
    text = INCLUDED.sub(
        lambda found: (ROOT / found[1]).read_text().strip(), (ROOT / page).read_text()
    )
    return [block for kind, block in BLOCK.findall(text) if kind in kinds]


def commands(page: str) -> Iterator[str]:
    """Lines of shell in blocks and by themselves, and commands within sentences."""
    for block in blocks(page, "sh", "sbatch", ""):
        block = re.sub(r"<<'EOF'\n.*?^EOF$", "", block, flags=re.DOTALL | re.MULTILINE)
        block = re.sub(r"\\\n\s*", "", block)
        yield from (line for line in block.splitlines() if line and not line.startswith("#"))
    text = BLOCK.sub("", (ROOT / page).read_text())
    for line in (*INDENTED.findall(text), *INLINE.findall(text)):
        if STARTED.match(line):
            yield line


def simple_commands(line: str) -> Iterator[list[str]]:
    """The words of each command of a line of shell, without variables and files of its output."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words: list[str] = []
    for word in [*lexer, ";"]:
        if not set(word) <= set(";|&<>()"):
            words.append(word)
            continue
        while words and re.fullmatch(r"[A-Z_]+=.*", words[0]):
            words.pop(0)
        if words:
            yield words
        words = ["echo"] if ">" in word else []


@functools.cache
def program() -> click.Group:
    found = typer.main.get_command(app)
    assert isinstance(found, click.Group)
    return found


def parse(words: list[str]) -> dict[str, Any]:
    """What the program reads from a command line.

    Raises:
        click.UsageError: It does not take it.
    """
    name, *rest = words
    if name.startswith("--"):
        return {}
    command = program().get_command(click.Context(program()), name)
    if command is None:
        raise click.UsageError(f"there is no command {name}")
    if not rest:
        return {}  # in a sentence the name alone may stand for the command
    with command.make_context(name, rest) as context:
        return dict(context.params)


def launched_files(words: list[str]) -> list[str]:
    """What a command of the launcher names of this checkout that is not there: files, and options
    of benchmarks.
    """
    files = {word for word in words if re.fullmatch(IN_CHECKOUT, word)}
    faults = sorted(word for word in files if not (ROOT / word).exists())
    options = [word for word in words if word.startswith("--") and word != "--with"]
    for script in files - {*faults}:
        if script.startswith("benchmarks/"):
            source = (ROOT / script).read_text()
            faults += [option for option in options if f'"{option}"' not in source]
    return faults


@functools.cache
def load(scene: str, variant: str | None, settings: tuple[str, ...]) -> Scene:
    return load_scene(ROOT / scene, variant=variant, overrides=settings)


def missing_names(given: Mapping[str, Any]) -> list[str]:
    """What the arguments of a command name that its scene has not; nothing where the scene is a
    placeholder.
    """
    named = str(given.get("scene") or given.get("file") or "")
    files = [str(value) for value in given.values() if re.match(OF_SCENES, str(value))]
    faults = [file for file in files if not (ROOT / file).exists()]
    if faults or not re.fullmatch(r"machines/.*\.toml", named):
        return faults
    settings = tuple(given.get("set_") or ())
    for variant in split_list(given.get("variants")):
        load(named, variant, settings)
    scene = load(named, given.get("variant"), settings)
    known: dict[str, Collection[str]] = {
        "pose": scene.poses,
        "analysis": NAMES,
        "name": {*scene.studies, *scene.sweeps},
    }
    for key, names in known.items():
        asked = given.get(key) or []
        asked = [asked] if isinstance(asked, str) else asked
        faults += [name for name in asked if name not in names]
    return faults


def find_program(words: list[str]) -> int | None:
    """Where the name of the program is, behind others that start it."""
    called = (n for n, word in enumerate(words) if re.fullmatch(r"(?:\S*/)?headstock", word))
    return next(called, None)


@pytest.mark.parametrize(
    "words",
    [
        ["run", "machines/cantilever.toml", "--accurracy", "1%"],
        ["runs", "machines/cantilever.toml"],
        ["sweep", "machines/three_axis.toml"],
    ],
)
def test_a_command_that_the_program_does_not_take_is_noticed(words: list[str]) -> None:
    with pytest.raises(click.UsageError):
        parse(words)


@pytest.mark.parametrize(
    ("words", "missing"),
    [
        (["run", "machines/cantilevers.toml"], "machines/cantilevers.toml"),
        (["run", "machines/three_axis.toml", "--analysis", "modes"], "modes"),
        (["study", "machines/cantilever.toml", "costs"], "costs"),
        (["show", "machines/three_axis.toml", "--pose", "left"], "left"),
    ],
)
def test_a_name_that_a_scene_has_not_is_noticed(words: list[str], missing: str) -> None:
    assert missing_names(parse(words)) == [missing]
    assert launched_files(["benchmarks/reduction.py", "--sices"]) == ["--sices"]


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_document_is_one_that_the_program_takes(page: str) -> None:
    faults = []
    for line in commands(page):
        for words in simple_commands(line):
            start = find_program(words)
            if start is None:
                if words[0] not in OTHER_PROGRAMS:
                    faults.append(f"{line}: {words[0]} is none of the programs that are known here")
                continue
            rest = [VALUES.get(word.strip("[]"), word.strip("[]")) for word in words[start + 1 :]]
            if not rest or rest[0] in LAUNCHER:
                faults += [f"{line}: {fault} does not exist" for fault in launched_files(rest)]
                continue
            try:
                given = parse(rest)
                faults += [f"{line}: {fault} does not exist" for fault in missing_names(given)]
                if rest[0] == "validate":
                    _select_cases(given.get("cases") or [])
            except (click.ClickException, ValueError) as error:
                faults.append(f"{line}: {error}")
    assert not faults, "\n".join(faults)


def join(base: dict[str, Any], fragment: Mapping[str, Any]) -> dict[str, Any]:
    """A scene with a fragment of another; whole joints and lists take the place of others."""
    for key, value in fragment.items():
        old = base.get(key)
        if isinstance(old, dict) and isinstance(value, dict) and "between" not in value:
            value = join(old, value)
        base[key] = value
    return base


TOML = [
    pytest.param(page, text, id=f"{Path(page).stem}-{number}")
    for page in PAGES
    for number, text in enumerate(blocks(page, "toml"))
    if not any(line in text for line in IN_OTHER_TESTS)
]


def complete(base: Base, text: str, folder: Path) -> Scene:
    """A scene with what a snippet adds.

    Raises:
        SceneError: They make no scene.
    """
    findings = Findings("")
    raw: dict[str, Any] = {**read_tables(ROOT / base.scene, findings, variant=base.variant)}
    raw["accept_defaults"] = True
    for key in base.without:
        *tables, last = key.split(".")
        del functools.reduce(operator.getitem, tables, raw)[last]
    return build_scene(join(raw, tomllib.loads(text)), findings, path=folder / "scene.toml")


@pytest.mark.parametrize(("page", "text"), TOML)
def test_a_fragment_of_a_document_completes_a_scene(page: str, text: str, tmp_path: Path) -> None:
    (tmp_path / "toolpath.csv").write_text("X [mm],Y [mm]\n0,0\n50,20\n")
    (tmp_path / "points.csv").write_text("name,component,x [mm],y [mm],z [mm]\n1,column,0,0,10\n")
    (tmp_path / "weights.csv").write_text("part,x [mm],y [mm],z [mm],mass [kg]\ncolumn,0,0,10,1\n")
    shutil.copy(ROOT / "tests/data/support.step", tmp_path / "assembly.step")
    refusals = []
    for base in BASES.get(page, OTHER_PAGES):
        try:
            machine = complete(base, text, tmp_path).machine
            break
        except SceneError as error:
            refusals.append(f"{base}: {error}")
    else:
        pytest.fail("\n".join(refusals))
    assert machine.components


def test_a_fragment_with_a_wrong_key_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="upto"):
        complete(Base(CANTILEVER), '[analyses.modal]\nupto = "500 Hz"\n', tmp_path)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")])
def test_the_python_of_a_document_compiles(page: str) -> None:
    texts = blocks(page, "python")
    assert texts
    for number, text in enumerate(texts):
        names = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
        assert names
        imported = "import " in text
        assert imported or (page, number) in NOT_EXECUTED, f"{page}: who executes snippet {number}?"
