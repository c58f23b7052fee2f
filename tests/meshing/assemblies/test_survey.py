"""What an assembly file holds, in every unit, with a tree and without."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from assemblies import BOLT, BRACKET, SMALL, Occurrence, Product, write_assembly, write_nameless

from common import approx
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import Frame
from headstock.meshing.assemblies import survey
from headstock.meshing.assemblies.solids import measure_solids
from headstock.meshing.assemblies.survey import survey_assembly
from headstock.meshing.errors import MeshError, PartFileError
from headstock.meshing.process.worker import Arrays

VOLUMES = [
    120 * 80 * 10 - 2 * 10 * np.pi * 4**2,
    *2 * [40 * 40 * 10 + 10 * 40 * 40 - 10 * np.pi * 4**2, np.pi * (4**2 * 20 + 7**2 * 5)],
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("assemblies")


@pytest.fixture(scope="module")
def small(folder: Path) -> Assembly:
    return survey_assembly(write_assembly(folder / "small.step", SMALL))


@pytest.fixture(scope="module")
def arrays(small: Assembly) -> Arrays:
    return measure_solids(str(small.path))


type Survey = Callable[..., Assembly]


@pytest.fixture
def changed(small: Assembly, arrays: Arrays, monkeypatch: pytest.MonkeyPatch) -> Survey:
    """The small assembly, had its worker found other arrays, or had one of its parts a fault."""

    def read(faults: list[str] | MeshError | None = None, **others: object) -> Assembly:
        def run(functions: list[str], *_: object, **__: object) -> Arrays:
            if functions == [survey.MEASURE]:
                return {**arrays, **{key: np.array(value) for key, value in others.items()}}
            if isinstance(faults, MeshError):
                raise faults
            return {"faults": np.array(faults or [], dtype=np.str_)}

        monkeypatch.setattr(survey, "run_apart", run)
        return survey_assembly(small.path, trial_seconds=0.0 if faults is None else 5.0)

    return read


def outline(assembly: Assembly) -> list[tuple[str, list[int]]]:
    """Parts with the numbers of their solids."""
    return [(part.name, [one.solid for one in part.placements]) for part in assembly.parts]


def largest_error(assembly: Assembly) -> float:
    """How far the placements move centres of mass beside those of their solids [m]."""
    errors = [0.0]
    for part in assembly.parts:
        first = np.array(assembly.solids[part.placements[0].solid - 1].center)
        for one in part.placements:
            moved = np.array(one.rotation) @ first + one.shift
            errors.append(np.abs(moved - assembly.solids[one.solid - 1].center).max())
    return float(max(errors))


def test_the_tree_names_solids_and_parts(small: Assembly) -> None:
    assert small.unit == "mm"
    assert small.remarks == ()
    assert [solid.names for solid in small.solids] == [
        ("small", "plate"),
        ("small", "left", "bracket"),
        ("small", "left", "bolt"),
        ("small", "right", "bracket"),
        ("small", "right", "bolt"),
    ]
    assert [solid.product for solid in small.solids[:3]] == ["Grundplatte ø", "Bracket 'L'", "bolt"]
    assert outline(small) == [("Grundplatte_o", [1]), ("Bracket_L", [2, 4]), ("bolt", [3, 5])]
    assert [part.fault for part in small.parts] == [None] * 3
    assert largest_error(small) < 1e-12
    nodes = [(node.name, node.product, node.solids) for node in small.tree.walk()]
    assert nodes[:3] == [
        ("small", "small", ()),
        ("plate", "Grundplatte ø", (1,)),
        ("left", "bolted bracket", ()),
    ]
    assert [numbers for _, _, numbers in nodes if numbers] == [(1,), (2,), (3,), (4,), (5,)]


def test_solids_are_measured(small: Assembly) -> None:
    assert [1e9 * solid.volume for solid in small.solids] == approx(VOLUMES)
    assert small.solids[0].area == approx(
        2 * (120 * 80 + 120 * 10 + 80 * 10 + 2 * np.pi * (4 * 10 - 4**2)) * 1e-6
    )
    assert small.solids[0].center == approx((0.06, 0.04, 0.005))
    assert small.solids[1].low == approx((0.01, 0.02, 0.01), abs=1e-6)
    assert small.solids[1].high == approx((0.05, 0.06, 0.06), abs=1e-6)
    assert small.solids[0].colour is None


def test_the_tree_rotates_a_round_bolt_as_it_is_placed(small: Assembly) -> None:
    half_turn = [approx(row, abs=1e-9) for row in ((-1, 0, 0), (0, -1, 0), (0, 0, 1))]
    for part in small.parts[1:]:
        assert list(part.placements[1].rotation) == half_turn
        assert part.placements[1].residual < 1e-12


@pytest.mark.parametrize(("unit", "write"), [("m", write_assembly), ("inch", write_nameless)])
def test_every_unit_gives_metres(
    folder: Path, small: Assembly, unit: str, write: Callable[[Path, Product, str], Path]
) -> None:
    assembly = survey_assembly(write(folder / f"{unit}.step", SMALL, unit), trial_seconds=0.0)
    assert assembly.unit == unit
    for solid, in_mm in zip(assembly.solids, small.solids, strict=True):
        assert solid.volume == approx(in_mm.volume, rel=1e-9)
        assert solid.center == approx(in_mm.center, abs=1e-9)
    assert largest_error(assembly) < 1e-9
    assert [numbers for _, numbers in outline(assembly)] == [[1], [2, 4], [3, 5]]
    if write is write_nameless:
        assert [part.name for part in assembly.parts] == ["part_1", "part_2", "part_3"]
        assert assembly.solids[1].names == ()
        assert assembly.tree.solids == (1, 2, 3, 4, 5)
        # a round bolt is not rotated without need
        assert np.array(assembly.parts[2].placements[1].rotation) == approx(np.eye(3), abs=1e-9)


def test_occurrences_of_one_name_take_their_solids_in_turn(folder: Path) -> None:
    places = [Frame(np.array([x, 0.0, 0.0])) for x in (0.0, 50.0)]
    bolts = Product("3 bolts", children=tuple(Occurrence("", BOLT, place) for place in places))
    pair = Product(
        "pair",
        children=(
            Occurrence("same", bolts, places[0]),
            Occurrence("same", bolts, Frame(np.array([0.0, 70.0, 0.0]))),
            Occurrence("bolt", BRACKET, Frame(np.array([0.0, 200.0, 0.0]))),
        ),
    )
    path = write_assembly(folder / "pair.step", pair)
    assembly = survey_assembly(path, trial_seconds=0.0)
    assert assembly.remarks == ()
    assert outline(assembly) == [("bolt", [1, 2, 3, 4]), ("Bracket_L", [5])]
    (first, second, last) = assembly.tree.children
    assert [child.solids for child in first.children + second.children] == [(1,), (2,), (3,), (4,)]
    assert last.solids == (5,)


def test_shapes_count_where_the_tree_disagrees(changed: Survey, arrays: Arrays) -> None:
    definitions = arrays["definitions"].copy()
    plate, bracket, bolt = (
        int(np.flatnonzero(arrays["labels"] == n)[0]) for n in ("plate", "bracket", "bolt")
    )
    definitions[definitions == definitions[bolt]] = definitions[bracket]
    products = arrays["products"].copy()
    products[[bolt, bolt + 3]] = products[bracket]
    paths = [str(path).replace("bolt/bolt", "bolt/Bracket 'L'") for path in arrays["paths"]]
    assembly = changed(definitions=definitions, products=products, paths=paths)
    assert outline(assembly) == [
        ("Grundplatte_o", [1]),
        ("Bracket_L", [2, 4]),
        ("Bracket_L_2", [3, 5]),
    ]
    assert assembly.remarks == ("\"Bracket 'L'\" is one product, but has 2 shapes: as many parts",)
    rotations = arrays["rotations"].copy()
    rotations[bracket + 3] = np.eye(3)
    assembly = changed(rotations=rotations, broken=2)
    assert assembly.remarks == (
        "2 occurrences in its tree refer to no product and are left out",
        "its tree rotates solid 4 otherwise than its shape does",
    )
    assert np.array(assembly.parts[1].placements[1].rotation) == approx(
        np.diag([-1, -1, 1]), abs=1e-9
    )
    assert plate == 1


def test_labels_that_are_written_otherwise_are_taken_in_order(changed: Survey) -> None:
    assembly = changed(paths=[f"Shapes/?{i}" for i in range(5)])
    assert outline(assembly) == [("Grundplatte_o", [1]), ("Bracket_L", [2, 4]), ("bolt", [3, 5])]


def test_a_part_that_cannot_be_meshed_is_named_and_the_rest_goes_on(changed: Survey) -> None:
    assembly = changed(faults=["", "no triangles on some of its faces (face:3)", ""])
    assert [part.fault for part in assembly.parts] == [
        None,
        "no triangles on some of its faces (face:3)",
        None,
    ]
    assembly = changed(faults=[""])
    assert assembly.remarks == (
        "the trial of surfaces ended after 5 s: of 2 parts it is seen in a run whether they can be meshed",
    )
    assembly = changed(faults=MeshError("small.step: it crashed"))
    assert [part.fault for part in assembly.parts] == [None] * 3
    assert assembly.remarks[0].startswith("small.step: it crashed: of 3 parts")


def test_what_is_no_whole_step_file_is_named(folder: Path, small: Assembly) -> None:
    text = small.path.read_bytes()
    cut = folder / "cut.step"
    cut.write_bytes(text[: len(text) // 2])
    with pytest.raises(PartFileError, match=r"^cut\.step is cut off"):
        survey_assembly(cut)
    for change, message in (
        (lambda text: b"solid part", "is not a STEP file"),
        (lambda text: text.replace(b"MANIFOLD_SOLID_BREP", b"MANIFOLD_SOLID"), "holds no solid"),
        (lambda text: text.replace(b"PRODUCT_CONTEXT", b"PDWAD"), "refers to other files"),
    ):
        cut.write_bytes(change(text))
        with pytest.raises(MeshError, match=message):
            measure_solids(str(cut))
    with pytest.raises(PartFileError, match="cannot be read"):
        survey_assembly(folder / "missing.step")
