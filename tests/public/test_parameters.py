"""Parameters of scenes: each is calculated once and read as what it is, and what they are written
out to has a limit.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import headstock as hs
from common import approx
from fixture_machines import machine, write_scene

SECONDS = 3.0  # of the processor, on a busy machine; the ordinary check of this scene takes 0.02
SCENE = machine("""
machine = "bar"
names = { bar = "block" }
without = ["points"]
components.block.solid = { box = ["40 mm", "60 mm", "= height"] }
components.block.fidelity = "rigid"
components.block.interfaces = { foot = { face = "z-" } }
variants.thin = { "parameters.leaf" = "2 mm" }
parameters.leaf = "1 mm"
""")


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    return lambda parameters, rest="": write_scene(tmp_path, f"{SCENE}{parameters}\n{rest}")


def chain(count: int, form: str) -> str:
    """``p0`` is calculated from ``p1``, and so on; the last is ``leaf``, and ``height`` is the
    first.
    """
    names = [f"p{number}" for number in range(count)] + ["leaf", "leaf"]
    lines = [f"{names[n]} = {form.format(names[n + 1], names[n + 2])}" for n in range(count)]
    return "\n".join(['height = "= p0"', *lines])


def height(path: Path, variant: str | None = None) -> float:
    components: Any = hs.load(path, variant=variant).components  # nouns, by name
    return float(components["block"].solid.box[2])


def problem(path: Path, variant: str | None = None) -> str:
    start = time.process_time()
    with pytest.raises(hs.SceneError) as error:
        hs.load(path, variant=variant)
    assert time.process_time() - start < SECONDS
    assert all(found.line for found in error.value.problems)
    return str(error.value)


def test_a_chain_of_thousands_and_sums_of_sums_are_calculated(write: Write) -> None:
    start = time.process_time()
    assert height(write(chain(3000, '"= {0} + 1 mm"'))) == approx(3.001)
    sums = write(chain(23, '"= {0} + {1}"'))
    assert height(sums) == approx(75.025)
    assert height(sums, "thin") == approx(150.05)
    # so many that neither a variant nor an error may look at them again for each use
    zeros = write(chain(2000, '"= {0} - {1} * 1"'))
    for variant in (None, "thin"):
        assert "block" in problem(zeros, variant)
    lost = write(chain(2000, '"= {0} + {1} / 2"').replace("leaf", "leef"))
    assert "unknown parameter 'leef'" in problem(lost, "thin")
    assert time.process_time() - start < 4 * SECONDS


@pytest.mark.parametrize(
    "form", ['["= {0}", "= {0}", "= {0}", "= {1}"]', '{{ x = "= {0}", y = ["= {0}", 2, "= {1}"] }}']
)
def test_lists_and_tables_of_each_other_have_a_limit(write: Write, form: str) -> None:
    said = problem(write(chain(40, form)))
    assert "components.block.solid.box[2]" in said
    assert "needs the parameter 'p0'" in said
    assert "holds more than 10000 entries" in said
    assert "write a shorter one" in said


def test_one_list_in_many_places_and_lists_in_each_other_have_a_limit(write: Write) -> None:
    loads = "\n".join(f'[loads.l{n}]\nat = "= long"' for n in range(1000))
    long = f'height = "1 m"\nlong = [{",".join("7" * 2000)}]'
    assert "write shorter lists" in problem(write(long, loads))
    text = f'height = "1 m"\nlong = "{"x" * 50_000}"'
    assert "write shorter lists" in problem(write(text, loads))
    assert "more than 50 levels" in problem(write(chain(300, '["= {0}"]')))


@pytest.mark.parametrize(
    "text", ["12 mm] * [3", "12 mm + 3 mm", "= 12 mm] * [3 mm", "3", "1 kg", "mm", "", "[12 mm]"]
)
def test_a_text_is_a_quantity_and_never_a_part_of_an_expression(write: Write, text: str) -> None:
    said = problem(write(f'a = "{text}"\nheight = "= a + 0 mm"'))
    assert "components.block.solid.box[2]" in said


def lines(form: str, count: int) -> str:
    """Parameters of a number and the next one, and a height that is one of them."""
    entries = [form.format(number, (number + 1) % count) for number in range(count)]
    return "\n".join([*entries, 'height = "= p1"'])


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ('height = "= a"\na = "= b"\nb = ["= a"]', "calculated from itself: a -> b -> a"),
        ('height = "= height * 1"', "calculated from itself: height -> height"),
        ('height = "= a * 1 mm"\na = 0x' + "f" * 5000, "more than 40 digits"),
        ('height = "= a * 1 mm"\na = inf', "write a number with a unit"),
        ('height = "= 2**2**40 * 1 mm"', "lacks a value before '*'"),
        ('height = "= 10^10^10 * 1 mm"', "cannot be read from"),
        ('height = "= 1e999 * 1e999 * 1e999 * 1 mm / a"\na = true', "no number"),
        ('height = "= ' + "1" * 300_000 + 'a"', "longer than 200"),
        (chain(3000, '"= {0} * {0}"'), "power of a unit beyond 30"),
        (chain(3000, '"= {0} * {0}"').replace("leaf", "12"), "range of numbers"),
        (lines('p{0} = "= p{1}"', 4000), "calculated from itself"),
        (lines('p{0} = "= q{0}"', 5000), "unknown parameter 'q1'"),
    ],
    ids=lambda text: text[:30],
)
def test_what_cannot_be_calculated_is_named_soon(
    write: Write, parameters: str, expected: str
) -> None:
    said = problem(write(parameters))
    assert expected in said
    assert len(said) < 50_000


def test_a_name_that_stands_for_a_text_may_stand_for_another_name(write: Write) -> None:
    lists = 'list = ["= a", { x = "= list2" }]\nlist2 = 3'
    assert height(write(f'height = "= a"\na = "= b"\nb = "5 µm"\n{lists}')) == approx(5e-6)


def test_places_in_places_have_a_limit_and_so_have_their_names(write: Write) -> None:
    places = "places = [" + ",".join(['["1 mm", "0 mm", "0 mm"]'] * 200) + "]"
    block = SCENE[SCENE.index("solid =") : SCENE.index("interfaces =")]
    many = f'[components.many]\n{block}{places}\n[components.many.interfaces.i]\nface = "z+"\n'
    inner = places.replace(', "0 mm"]', "]")
    rect = f'rect = {{ size = ["1 mm", "1 mm"] }}\n{inner}\n'
    patches = "[[components.many.interfaces.i.patches]]"
    said = problem(write('height = "1 m"', f"{many}{rect}{patches}\n{rect}"))
    assert "components.many.places" in said
    assert "write fewer places" in said
    named = '[joints.k]\nkind = "{text}"\nbetween = ["ground", "block.foot"]\nplaces.{name} = []\n'
    long = named.format(text="{n}" * 50_000, name="x" * 100_000)
    assert "is no name of a place" in problem(write('height = "1 m"', long))


def test_overrides_of_long_or_many_keys_end_soon(write: Write) -> None:
    many = "\n".join(f'a{n} = "1 mm"' for n in range(6000)) + '\nheight = "= a0 + a5999"'
    changed = "\n".join(f'"parameters.a{n}" = "2 mm"' for n in range(6000))
    start = time.process_time()
    assert height(write(many, f"[variants.all]\n{changed}"), "all") == approx(0.004)
    assert time.process_time() - start < SECONDS
    name = "_" * 400_000
    variant = f'[variants.all]\n"joints.{name}.kind" = "rigid"'
    said = problem(write('height = "1 m"', variant), "all")
    assert "cannot set joints" in said
