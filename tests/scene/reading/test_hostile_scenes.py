"""no scene file, however made, costs more than a second or 256 MiB, or ends in anything but a
list of problems.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from common import run_process
from faults.runs import SCENE
from faults.scene_fuzz import MB_ALLOWED, SECONDS_ALLOWED, run_scene_fuzz

pytestmark = [pytest.mark.hard("H48"), pytest.mark.workers]

PART = '[components.c{i}]\nsolid={{box=["1 m","1 m","1 m"]}}\nmaterial="steel"\nfidelity="rigid"\n[components.c{i}.interfaces]\na={{face="z-"}}\n'
JOINT = '[joints.j{i}]\nbetween=["colunm{i}.foot","column.tipp{i}"]\nkind="rigid"\n'
COLUMN = 'box = ["40 mm", "60 mm", "200 mm"]'
RIBS = 'column = { size = ["400 mm", "600 mm", "2 m"], wall = "9 mm", cap = "9 mm", rib = "1e-9 mm", ribs_z = 10000000 }'


def repeat(count: int, text: str) -> str:
    return "".join(text.format(i=i) for i in range(count))


PLACES = "places = [" + ",".join(["[]"] * 200) + "]"

HOSTILE: dict[str, Callable[[], str]] = {
    "two megabytes": lambda: SCENE + "#" * (2 << 20),
    "nested tables": lambda: SCENE + "x = " + "{a=" * 100_000,
    "nested lists": lambda: SCENE + "x = " + "[" * 100_000 + "]" * 100_000,
    "dotted key": lambda: ".".join("a" * 100_000) + " = 1",
    "a million keys": lambda: "".join(f"k{i}=1\n" for i in range(100_000)),
    "unknown keys": lambda: SCENE + "[limits]\n" + repeat(15_000, "k{i} = 1\n"),
    "many variants": lambda: (
        SCENE + repeat(4000, '[variants.v{i}]\n"components.column.fidelity" = "rigid"\n')
    ),
    "large variant": lambda: (
        SCENE + "[variants.v]\n" + repeat(8000, '"components.column.interfaces.i{i}.face" = "z+"\n')
    ),
    "nested variants": lambda: (
        SCENE.replace("[variants", "[poses")
        + "[variants]\n"
        + repeat(3000, 'v{i} = {{ "a.b" = {{}} }}\n')
    ),
    "unknown names": lambda: SCENE + repeat(3000, JOINT),
    "floating parts": lambda: SCENE + repeat(1500, PART),
    "ribs": lambda: SCENE.replace(COLUMN, RIBS),
    "poses": lambda: SCENE + repeat(15_000, "[poses.p{i}]\n"),
    "units": lambda: (
        SCENE + repeat(3000, '[loads.l{i}]\nat="column.tip"\nforce=["1 N^{i}","0 N","0 N"]\n')
    ),
    "long unit": lambda: SCENE.replace("40 mm", "4 " + "m*" * 5000 + "m"),
    "huge power": lambda: SCENE.replace("40 mm", "4 m**9**9**9"),
    "huge integer": lambda: SCENE.replace("modes = 8", "modes = " + "9" * 4000),
    "lists of lists": lambda: (
        SCENE.replace("40 mm", "= a0")
        + "[parameters]\n"
        + "".join(f'a{i} = ["= a{i + 1}", "= a{i + 1}"]\n' for i in range(60))
    ),
    "chain of parameters": lambda: (
        SCENE.replace("40 mm", "= a0")
        + "[parameters]\n"
        + "".join(f'a{i} = "= a{i + 1} + a{i + 2}"\n' for i in range(6000))
    ),
    "places in places": lambda: (
        SCENE
        + PART.format(i="").replace("fidelity", f"{PLACES}\nfidelity")
        + f"[components.c.interfaces.b]\nface='z+'\n{PLACES}\nrect={{size=['1 mm','1 mm']}}\n"
    ),
    "byte order mark": lambda: "\ufeff" + SCENE,
    "NO and 1e3": lambda: SCENE.replace("modes = 8", "modes = NO") + "x = 1e3\n",
    "duplicate keys": lambda: SCENE + '[materials.steel]\nE = "1 GPa"\n',
    "python tag": lambda: SCENE + 'x = !!python/object/apply:os.system ["true"]\n',
}
# one process loads the libraries; each scene has a copy of it for itself, whose memory counts from
# there
TRY = """
import json, os, sys, time
from pathlib import Path
from headstock.pipeline.planning.resources import peak_memory_mb
from faults.scene_fuzz import try_scene
for name in sys.argv[1:]:
    if os.fork():
        os.wait()
        continue
    start = time.process_time()
    ending = try_scene(Path(name), ())
    seconds = time.process_time() - start
    print(json.dumps([name, ending, seconds, peak_memory_mb()]), flush=True)
    os._exit(0)
"""
MEANT_TO_LOAD = {"many variants", "large variant"}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[str, float, float]]:
    """How each scene ended, its processor time [s] and the peak of its memory [MiB]; nothing where
    its process died.
    """
    folder = tmp_path_factory.mktemp("hostile")
    paths = {str(folder / f"{number}.toml"): name for number, name in enumerate(HOSTILE)}
    for path, name in paths.items():
        Path(path).write_text(HOSTILE[name]())
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = run_process([sys.executable, "-c", TRY, *paths], env=variables, timeout=600)
    assert done.returncode == 0, done.stderr
    tries = [json.loads(line) for line in done.stdout.splitlines()]
    return {paths[path]: (ending, seconds, peak) for path, ending, seconds, peak in tries}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_scene_is_answered_within_256_mebibytes(
    name: str, answers: dict[str, tuple[str, float, float]]
) -> None:
    ending, _, megabytes = answers[name]
    assert (ending == "refused") == (name not in MEANT_TO_LOAD)
    assert megabytes < MB_ALLOWED


@pytest.mark.trials  # a busy machine is slower
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_scene_is_answered_within_a_second(
    name: str, answers: dict[str, tuple[str, float, float]]
) -> None:
    assert answers[name][1] < SECONDS_ALLOWED


@pytest.mark.trials
def test_three_hundred_damaged_scenes_load_or_are_refused(tmp_path: Path) -> None:
    outcome = run_scene_fuzz(300, seed=48, root=tmp_path)
    assert outcome.faults == []
    assert outcome.trials == 300
    assert outcome.slowest_seconds < SECONDS_ALLOWED
    assert outcome.happened["refused"] > 150
    assert outcome.happened["loaded and planned"] > 6
