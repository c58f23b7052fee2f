"""Is this tree fit to be released? Builds wheel and source archive and prints a table of what holds.

    ./headstock release-check [--final]

What is still to be done before a release (a dated section of the changelog, uncommitted changes) is
"open", and fails with ``--final`` only. Exit code 1 where anything fails.
"""

import argparse
import json
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from email.parser import Parser
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import yaml

PROJECT = Path(__file__).resolve().parents[1]

# tracked files that source archives leave out: links that ./headstock makes anew, and what concerns
# git and editors alone
NOT_IN_SDIST = (".typing/*", ".git*", "*/.gitignore", ".vscode/*")
# of the viewer only what is packed from the others goes into wheels
NOT_IN_WHEEL = ("app/report/viewer/package*.json", "*.md", "*/.npmrc", "*/.gitignore")

FMI_HEADERS = [
    f"pipeline/exchange/fmu/{name}.h"
    for name in (
        *("fmi2FunctionTypes", "fmi2Functions", "fmi2TypesPlatform"),
        *("fmi3FunctionTypes", "fmi3Functions", "fmi3PlatformTypes"),
    )
]
# files that others made, or that hold what others made, and where their licence is
FOREIGN = {
    "app/report/viewer/viewer.bundle.js": "app/report/viewer/LICENSES.txt",
    "docs/javascripts/iframe-worker.js": "docs/javascripts/iframe-worker.LICENSE",
    "tests/data/support.step": "tests/data/support.LICENSE",
    **dict.fromkeys(FMI_HEADERS, "pipeline/exchange/fmu/LICENSES.txt"),
}
# files of kinds that come from others as a rule, and what of this project writes them
OWN = {
    "machines/barc.step": "machines/barc_parts.py",
    "docs/javascripts/search_words.js": "",
    "machines/garteur_sensors.csv": "",
    "machines/three_axis_push.csv": "",
    "machines/step_column.step": "machines/step_column_part.py",
    "app/report/response_cursor.js": "",
    "app/report/sweep_maps.js": "",
    "app/report/viewer/viewer.js": "",
}
OWN_FOLDERS = ("tests/data/nastran_forms/",)  # decks of our own, every form of one cube
DOUBTFUL = (
    *("step", "stp", "iges", "igs", "brep", "stl", "msh", "inp", "bdf", "med", "xdmf", "h5"),
    *("vtu", "mat", "csv", "js", "woff", "woff2", "ttf", "otf", "jar", "so", "whl", "gz", "zip"),
)
HOLDER = re.compile(r"[Cc]opyright\s+(?:©|\(c\)|\(C\))[^\n]*")

# what packages of Debian are called by conda-forge
IN_CONDA = {
    "python3-dolfinx-real": "fenics-dolfinx",
    "python3-petsc4py-real": "petsc4py",
    "python3-slepc4py-real": "slepc4py",
    "openmpi-bin": "openmpi",
    "libopenblas0-pthread": "libblas",
    "libmetis5": "metis",
    "libsuitesparse-dev": "suitesparse",
    "gcc": "c-compiler",
    "g++": "cxx-compiler",
    "python3-dev": "python",
    "python3-gmsh": "python-gmsh",
    "python3-h5py-mpi": "h5py",
    "python3-matplotlib": "matplotlib-base",
    "python3-yaml": "pyyaml",
    "cython3": "cython",
}
# what else packages of pip are called by Debian
IN_DEBIAN = {"pillow": "python3-matplotlib"}  # which depends on it
FROM_PIP = {"pyuff"}  # in test_data.txt: neither Debian nor conda has it
# groups that one command loads
LOADED_TOGETHER = (
    {"pictures.txt", "test_data.txt", "docs.txt", "notebook.txt", "python.txt", "dolfinx-new.txt"},
    {"pictures.txt", "test_data.txt", "tests.txt", "dolfinx-new.txt"},
    {"pictures.txt", "test_data.txt", "benchmarks.txt"},
    {"pictures.txt", "test_data.txt", "tests.txt", "neighbours.txt"},
)
# only a whole system needs these, or a conda environment has them with Python, VTK and PETSc
ONLY_DEBIAN = {
    *("libegl1", "libegl-mesa0", "libgl1-mesa-dri", "libxrender1"),
    *("python3-venv", "ca-certificates", "procps", "fish"),
}
# pictures.txt brings these to Debian; conda has its own builds of PETSc and SLEPc to choose
ONLY_CONDA = {"petsc", "slepc", "pillow", "pyvista", "vtk"}


@dataclass(frozen=True)
class Row:
    """A line of the table.

    Attributes:
        name: What was looked at.
        found: What there is, where nothing is wrong.
        wrong: What fails; nothing where the check passes.
        open: What is to be done before a release.
    """

    name: str
    found: str
    wrong: tuple[str, ...] = ()
    open: tuple[str, ...] = ()


def check_version(tree: Path) -> Row:
    """One version in pyproject.toml, CITATION.cff and the newest section of CHANGELOG.md."""
    version = read_pyproject(tree)["version"]
    citation = yaml.safe_load((tree / "CITATION.cff").read_text())
    heading = re.search(r"^## (\S+)(?: \((.*)\))?$", (tree / "CHANGELOG.md").read_text(), re.M)
    newest, dated = heading.groups() if heading else (None, None)
    wrong, still = [], []
    if citation["version"] != version:
        wrong.append(f"CITATION.cff says {citation['version']}, pyproject.toml {version}")
    if newest != version:
        wrong.append(f"the newest section of CHANGELOG.md is of {newest}, pyproject.toml {version}")
    elif dated is None or not re.fullmatch(r"\d{4}-\d\d-\d\d", dated):
        still.append(f"CHANGELOG.md: give the section of {version} its date, as (2026-12-31)")
    elif str(citation.get("date-released")) != dated:
        wrong.append(
            f"CITATION.cff has date-released {citation.get('date-released')}, CHANGELOG.md {dated}"
        )
    return Row("version", version, tuple(wrong), tuple(still))


def check_pins(tree: Path) -> Row:
    """Packages of pip have one version each, the same in every group, and its hashes."""
    versions: defaultdict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    wrong = []
    for path in pip_groups(tree):
        lines = list(entries(path.read_text().replace("\\\n", " ")))
        if not lines:
            wrong.append(f"{path.name} is empty")
        for line in lines:
            package, *hashes = line.split()
            name, _, version = package.partition("==")
            versions[name.lower()][version].append(path.name)
            if not version or "*" in version:
                wrong.append(f"{path.name}: {name} has no version")
            if not hashes or not all(
                re.fullmatch(r"--hash=sha256:[0-9a-f]{64}", item) for item in hashes
            ):
                wrong.append(f"{path.name}: {name} has no hash, or one that is none")
    for name, files in versions.items():
        for loaded in LOADED_TOGETHER:
            held = {version for version, found in files.items() if loaded & set(found)}
            if len(held) > 1:
                wrong.append(f"{name} has several versions in one command: {', '.join(held)}")
    groups = len(pip_groups(tree))
    return Row("pip packages", f"{len(versions)} in {groups} groups, with hashes", tuple(wrong))


def check_lists(tree: Path) -> Row:
    """What Debian, conda, the container and pip are asked for is the same."""
    debian = set(entries((tree / "environment" / "packages.txt").read_text()))
    asked = yaml.safe_load((tree / "environment.yml").read_text())["dependencies"]
    conda = {re.split(r"[=<>]", item)[0] for item in asked}
    expected = {conda_name(name): name for name in debian - ONLY_DEBIAN}
    wrong = [
        f"environment.yml lacks {name}, packages.txt has {expected[name]}"
        for name in sorted(set(expected) - conda)
    ]
    wrong += [
        f"environment.yml has {name}, packages.txt has nothing of the kind"
        for name in sorted(conda - set(expected) - ONLY_CONDA)
    ]
    wrong += [
        f"packages.txt has no {name}, which release-check knows as Debian's alone"
        for name in sorted(ONLY_DEBIAN - debian)
    ]
    for line in read_pyproject(tree)["dependencies"]:
        name = re.split(r"[=<>]", line)[0]
        if name in FROM_PIP:
            continue
        if IN_DEBIAN.get(name, f"python3-{name}") not in debian:
            wrong.append(f"packages.txt lacks {name}, pyproject.toml has it")
        if name not in conda and f"{name}-base" not in conda:
            wrong.append(f"environment.yml lacks {name}, pyproject.toml has it")
    wrong += container_problems(tree)
    found = f"{len(debian)} of Debian, {len(conda)} of conda, Dockerfile"
    return Row("lists of packages", found, tuple(wrong))


def container_problems(tree: Path) -> Iterator[str]:
    """Where the Dockerfile takes packages from elsewhere than the lists, or another Debian."""
    recipe = (tree / "Dockerfile").read_text()
    suites = {"13": "trixie"}
    release = re.search(r"^FROM debian:(\d+)", recipe, re.M)
    suite = re.search(r"^suite=(\w+)", (tree / "environment" / "build_root.sh").read_text(), re.M)
    if not release or not suite or suites.get(release[1]) != suite[1]:
        yield "the Dockerfile begins with another Debian than environment/build_root.sh"
    for name in ("packages", "pictures", "test_data"):
        if not re.search(rf"^COPY .*environment/{name}\.txt", recipe, re.M):
            yield f"the Dockerfile does not take environment/{name}.txt"
    if re.search(r"apt-get install [^\n|&]*\b(?:python3|lib)[\w-]", recipe):
        yield "the Dockerfile names packages itself"
    if "--require-hashes" not in recipe:
        yield "the Dockerfile installs from pip without hashes"


def check_licences(tree: Path, files: Iterable[str]) -> Row:
    """What others made has its licence beside it, and whoever holds a copyright is in one."""
    shipped = {name for name in files if not matches(name, NOT_IN_SDIST)}
    project = read_pyproject(tree)
    wrong = []
    if project["license"] != "MIT" or "MIT License" not in (tree / "LICENSE").read_text():
        wrong.append("LICENSE is not the MIT License that pyproject.toml names")
    bundled = {name for name in FOREIGN.values() if name.partition("/")[0] in {"app", "pipeline"}}
    wrong += [
        f"license-files of pyproject.toml lacks {name}"
        for name in sorted({"LICENSE", *bundled} - set(project["license-files"]))
    ]
    for name, licence in FOREIGN.items():
        if name not in shipped:
            wrong.append(f"{name} is gone: take it from FOREIGN in .ci/release_check.py")
        if licence not in shipped or not HOLDER.search((tree / licence).read_text()):
            wrong.append(f"{licence}, the licence of {name}, is missing or names no holder")
    for name in sorted(shipped):
        if name.rpartition(".")[2] in DOUBTFUL and not (
            name in OWN or name in FOREIGN or name.startswith(OWN_FOLDERS)
        ):
            wrong.append(f"{name}: whose is it? Add it to OWN or FOREIGN in .ci/release_check.py")
        if name in {"LICENSE", *FOREIGN.values(), *FOREIGN} or name.endswith(".png"):
            continue
        if holder := HOLDER.search((tree / name).read_text(errors="replace")):
            wrong.append(f"{name} names a holder that no licence file does: {holder[0]}")
    wrong += [
        f"{name} is written by {writer}, which is gone"
        for name, writer in OWN.items()
        if writer and writer not in shipped
    ]
    wrong += viewer_problems(tree)
    return Row("licences", f"MIT; {len(FOREIGN)} files of others with theirs", tuple(wrong))


def viewer_problems(tree: Path) -> Iterator[str]:
    """Where the script in every report is of another version than its list of packages, or holds
    packages whose licence is missing.
    """
    folder = tree / "app" / "report" / "viewer"
    licences = (folder / "LICENSES.txt").read_text()
    packages = json.loads((folder / "package.json").read_text())["devDependencies"]
    for name, version in packages.items():
        if name == "esbuild":  # packs the script and leaves nothing of itself in it
            continue
        if f"{name}.js" not in licences:
            yield f"LICENSES.txt of the viewer does not name {name}"
        revision = version.split(".")[1]
        if f'"{revision}"' not in (folder / "viewer.bundle.js").read_text():
            yield f"viewer.bundle.js was not packed from {name} {version}: npm run build"


def check_wheel(tree: Path, files: Iterable[str], wheel: Path) -> Row:
    """Every module and asset of the layers, nothing else, and the program's door."""
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
        notes = next(name for name in held if name.endswith(".dist-info/METADATA"))
        metadata = Parser().parsestr(archive.read(notes).decode())
        beside = notes.removesuffix("METADATA")
        doors = archive.read(f"{beside}entry_points.txt").decode()
    expected = {wheel_name(name) for name in files if in_wheel(tree, name)}
    expected |= {f"{beside}licenses/{name}" for name in read_pyproject(tree)["license-files"]}
    own = {f"{beside}{name}" for name in ("METADATA", "WHEEL", "RECORD", "entry_points.txt")}
    wrong = differences(expected, held - own - {f"{beside}top_level.txt"}, wheel.name)
    version = read_pyproject(tree)["version"]
    if metadata["Version"] != version:
        wrong.append(f"the wheel is of version {metadata['Version']}, pyproject.toml {version}")
    if metadata["License-Expression"] != "MIT" or not metadata.get_payload():
        wrong.append("the wheel's metadata lack the licence or the description")
    for module in re.findall(r"= ([\w.]+):", doors):
        if f"{module.replace('.', '/')}.py" not in held:
            wrong.append(f"the wheel's program starts {module}, which is not in it")
    size = wheel.stat().st_size / 1e6
    return Row("wheel", f"{wheel.name}, {len(held)} files, {size:.1f} MB", tuple(wrong))


def check_sdist(files: Iterable[str], sdist: Path) -> Row:
    """Every tracked file but those of git and editors."""
    with tarfile.open(sdist) as archive:
        names = {item.name.partition("/")[2] for item in archive if not item.isdir()}
    expected = {name for name in files if not matches(name, NOT_IN_SDIST)}
    made = {"PKG-INFO", "setup.cfg"}
    held = {name for name in names if ".egg-info/" not in name} - made
    wrong = differences(expected, held, sdist.name)
    size = sdist.stat().st_size / 1e6
    found = f"{sdist.name}, {len(held)} files, {size:.1f} MB"
    return Row("source archive", found, tuple(wrong))


def check_rebuilt(wheel: Path, rebuilt: Path) -> Row:
    """The wheel that is built from the source archive holds the same bytes."""
    with zipfile.ZipFile(wheel) as first, zipfile.ZipFile(rebuilt) as second:
        contents = [
            {name: archive.read(name) for name in archive.namelist() if "RECORD" not in name}
            for archive in (first, second)
        ]
    wrong = differences(set(contents[0]), set(contents[1]), "the wheel from the source archive")
    wrong += [
        f"{name} differs"
        for name in sorted(set(contents[0]) & set(contents[1]))
        if contents[0][name] != contents[1][name]
    ]
    return Row("wheel from it", "the same bytes", tuple(wrong))


def check_commit(tree: Path) -> Row:
    """What is checked is what is committed."""
    changed = git(tree, "status", "--porcelain").splitlines()
    still = (f"{len(changed)} changes are not committed",) if changed else ()
    return Row("commit", git(tree, "rev-parse", "--short=10", "HEAD").strip(), (), still)


def build_archives(tree: Path, files: Iterable[str], folder: Path) -> tuple[Path, Path, Path]:
    """Wheel, source archive and the wheel from that, of a copy of the tracked files: setuptools
    leaves folders beside what it builds.
    """
    copy = folder / "tree"
    for name in files:
        if matches(name, (".typing/*",)):
            continue
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes((tree / name).read_bytes())
        (copy / name).chmod((tree / name).stat().st_mode)
    wheel, sdist = build(copy, folder / "dist", "wheel"), build(copy, folder / "dist", "sdist")
    with tarfile.open(sdist) as archive:
        archive.extractall(folder / "unpacked", filter="data")
    (unpacked,) = (folder / "unpacked").iterdir()
    return wheel, sdist, build(unpacked, folder / "rebuilt", "wheel")


def build(tree: Path, folder: Path, kind: str) -> Path:
    """``wheel`` or ``sdist`` of a tree, by its own build backend and without a registry."""
    folder.mkdir(exist_ok=True)
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(folder)!r}))"
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        cwd=tree,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"setuptools could not build the {kind}:\n{done.stderr}")
    return folder / done.stdout.splitlines()[-1]


def entries(text: str) -> Iterator[str]:
    """Lines of a list of packages."""
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            yield line.strip()


def pip_groups(tree: Path) -> list[Path]:
    """The lists of pip packages."""
    folder = tree / "environment"
    return sorted(path for path in folder.glob("*.txt") if path.name != "packages.txt")


def conda_name(package: str) -> str:
    """What a package of Debian is called by conda-forge."""
    return IN_CONDA.get(package, package.removeprefix("python3-"))


def read_pyproject(tree: Path) -> dict[str, Any]:
    """The table of the project."""
    table: dict[str, Any] = tomllib.loads((tree / "pyproject.toml").read_text())["project"]
    return table


def in_wheel(tree: Path, name: str) -> bool:
    """Whether a tracked file belongs into the wheel: it lies in a layer, which has a py.typed, or
    is a part of the launcher.
    """
    layer = name.partition("/")[0]
    typed = (tree / layer / "py.typed").is_file() and not layer.startswith(".")
    installed = layer == "environment" and name.endswith(".sh")
    return (typed or installed) and not matches(name, NOT_IN_WHEEL)


def wheel_name(name: str) -> str:
    """Place in the wheel of a tracked file; the folder ``api`` is the package itself."""
    return f"headstock/{name.removeprefix('api/')}"


def matches(name: str, patterns: Iterable[str]) -> bool:
    """Whether any of some patterns fits."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def differences(expected: set[str], held: set[str], archive: str) -> list[str]:
    """What an archive lacks, and what it should not hold."""
    return [f"{archive} lacks {name}" for name in sorted(expected - held)] + [
        f"{archive} holds {name}" for name in sorted(held - expected)
    ]


def git(tree: Path, *words: str) -> str:
    """What git says of a checkout."""
    command = ["git", "-C", str(tree), "-c", "safe.directory=*", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def tracked_files(tree: Path) -> list[str]:
    """Files of a checkout that git knows and that are there."""
    names = git(tree, "ls-files", "-z").split("\0")
    return [name for name in names if name and (tree / name).exists()]


def check_tree(tree: Path, files: list[str]) -> list[Row]:
    """What can be seen without building anything."""
    return [check_version(tree), check_pins(tree), check_lists(tree), check_licences(tree, files)]


def describe(rows: Iterable[Row]) -> Iterator[str]:
    """The table, a row or several for each check."""
    rows = list(rows)
    width = max(len(row.name) for row in rows)
    for row in rows:
        state = "FAILS" if row.wrong else "open" if row.open else "ok"
        yield f"{state:6} {row.name:{width}}  {row.found}"
        yield from (f"{'':6} {'':{width}}  - {text}" for text in (*row.wrong, *row.open))


def main(words: list[str] | None = None, say: Callable[[str], None] = print) -> int:
    """Check the checkout this file lies in."""
    parser = argparse.ArgumentParser(prog="headstock release-check", description=__doc__)
    parser.add_argument("--final", action="store_true", help="what is open fails, too")
    final = parser.parse_args(words).final
    files = tracked_files(PROJECT)
    rows = [check_commit(PROJECT), *check_tree(PROJECT, files)]
    with tempfile.TemporaryDirectory(prefix="headstock-release-") as folder:
        wheel, sdist, rebuilt = build_archives(PROJECT, files, Path(folder))
        rows += [
            check_wheel(PROJECT, files, wheel),
            check_sdist(files, sdist),
            check_rebuilt(wheel, rebuilt),
        ]
        for line in describe(rows):
            say(line)
    failing = [row.name for row in rows if row.wrong or (final and row.open)]
    waiting = [row.name for row in rows if row.open]
    if failing:
        say(f"not fit for a release: {', '.join(failing)}")
    elif waiting:
        say(f"nothing fails; open before a release: {', '.join(waiting)}")
    else:
        say("fit for a release")
    return 1 if failing else 0


if __name__ == "__main__":
    sys.exit(main())
