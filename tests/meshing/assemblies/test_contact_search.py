"""Contacts of an assembly are those that its parts were put together with: all of them, no other."""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import gmsh
import numpy as np
import pytest
from assemblies import SMALL, Occurrence, Product, write_assembly, write_nameless
from frame_assembly import Frame, build_frame, build_small_frame

from built_parts import gmsh_session
from common import approx, work_here
from headstock.geometry.assemblies.contact_patches import write_contact_patches
from headstock.geometry.assemblies.contacts import Contact
from headstock.geometry.assemblies.pair_motions import find_pair_motions
from headstock.geometry.assemblies.parts import Assembly
from headstock.geometry.frames import Frame as Place
from headstock.geometry.frames import rotation_about
from headstock.meshing.assemblies.contact_search import find_contacts
from headstock.meshing.assemblies.survey import survey_assembly
from headstock.meshing.errors import MeshError
from headstock.meshing.process import isolation, strangers
from headstock.meshing.process.worker import call_apart

pytestmark = pytest.mark.slow

MOVED = Place(np.array([123.0, -456.0, 78.0]), rotation_about(np.array([1.0, 2.0, 3.0]), 0.7))
# a foot of 40 x 40 with a hole of 8 on the plate, on it the head of a bolt of 14
FOOT, HEAD = 1600.0 - 16.0 * math.pi, 33.0 * math.pi


@pytest.fixture(scope="module", autouse=True)
def _in_this_process() -> Iterator[None]:
    """Starting a worker process takes longer than what it does here; one test has one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strangers, "call_apart", work_here)
        yield


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Assembly:
    path = write_assembly(tmp_path_factory.mktemp("small") / "small.step", SMALL)
    return survey_assembly(path, trial_seconds=0.0)


def write_frame(path: Path, build: Callable[[], Frame]) -> Frame:
    with gmsh_session():
        frame = build()
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return frame


def assert_expected(frame: Frame, contacts: Sequence[Contact]) -> None:
    names = {number: name for name, number in frame.numbers().items()}

    def name_all(
        rows: Sequence[tuple[int, int, str, float]],
    ) -> Counter[tuple[str, str, str, float]]:
        return Counter((names[a], names[b], kind, round(gap, 3) + 0.0) for a, b, kind, gap in rows)

    found = name_all([(*one.solids, one.kind, 1e3 * one.gap) for one in contacts])
    assert found == name_all(frame.expected())


def summarize(contacts: Sequence[Contact]) -> Counter[tuple[str, float]]:
    """Kinds and areas [mm^2]."""
    return Counter((one.kind, round(1e6 * one.area, 2) + 0.0) for one in contacts)


def swapped(product: Product) -> Product:
    children = tuple(
        Occurrence(one.name, swapped(one.product), one.frame) for one in product.children[::-1]
    )
    return Product(product.name, product.build, children)


def test_a_bolted_bracket_touches_on_its_foot_its_head_and_along_its_shank(small: Assembly) -> None:
    contacts = find_contacts(small)
    shank = 2.0 * math.pi * 4.0 * 10.0
    areas = {("plane", FOOT): 2, ("plane", HEAD): 2, ("cylinder", shank): 4}
    assert summarize(contacts) == {(kind, round(area, 2)): n for (kind, area), n in areas.items()}
    plate = next(solid.number for solid in small.solids if "rundplatte" in solid.product)
    on_plate = [one for one in contacts if plate in one.solids and one.kind == "plane"]
    assert sorted(one.center[0] for one in on_plate) == approx([0.03, 0.09])
    for contact in on_plate:
        side = 1 - contact.solids.index(plate)
        assert contact.axis[2] == approx(-1.0 if side == 0 else 1.0)
        assert contact.covered[side] == approx((1.0,))
        # both brackets are the same part, in its coordinates
        (patch,) = write_contact_patches(small, contact, side)
        assert patch == f'{{ face = "face:{contact.faces[side][0]}" }}'
    assert len({one.faces[1 - one.solids.index(plate)] for one in on_plate}) == 1


@pytest.mark.parametrize("unit", ["m", "inch"])
def test_contacts_are_the_same_in_any_unit_order_and_place(tmp_path: Path, unit: str) -> None:
    moved = Product("moved", children=(Occurrence("all", swapped(SMALL), MOVED),))
    write = write_nameless if unit == "m" else write_assembly
    contacts = find_contacts(
        survey_assembly(write(tmp_path / "moved.step", moved, unit), trial_seconds=0.0)
    )
    shank = 2.0 * math.pi * 4.0 * 10.0
    assert summarize(contacts) == {
        ("plane", round(FOOT, 2)): 2,
        ("plane", round(HEAD, 2)): 2,
        ("cylinder", round(shank, 2)): 4,
    }
    up = MOVED.rotation[:, 2]
    assert [abs(float(up @ one.axis)) for one in contacts] == approx([1.0] * 8)


@pytest.fixture(scope="module")
def small_frame(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[Frame, Assembly, tuple[Contact, ...]]:
    path = tmp_path_factory.mktemp("frame") / "frame.step"
    frame = write_frame(path, build_small_frame)
    assembly = survey_assembly(path, trial_seconds=0.0)
    return frame, assembly, find_contacts(assembly)


def test_air_of_a_guide_tight_threads_and_washers_are_told_from_what_is_only_near(
    small_frame: tuple[Frame, Assembly, tuple[Contact, ...]],
) -> None:
    frame, _, contacts = small_frame
    assert_expected(frame, contacts)
    assert {round(1e3 * one.gap, 6) for one in contacts if one.wide} == {3.0}
    assert sum(one.wide for one in contacts) == 6


def test_carriages_guide_and_a_screwed_rail_does_not(
    small_frame: tuple[Frame, Assembly, tuple[Contact, ...]],
) -> None:
    frame, assembly, contacts = small_frame
    names = {number: name for name, number in frame.numbers().items()}
    motions = {
        tuple(names[number] for number in one.solids): one
        for one in find_pair_motions(assembly, contacts)
    }
    guides = {pair for pair, one in motions.items() if one.likely == "guide"}
    assert guides == {("left_rail", f"left_carriage_{i}") for i in (1, 2)}
    carriage = motions["left_rail", "left_carriage_1"]
    assert carriage.slides == ((0.0, 1.0, 0.0),)
    assert carriage.turns == ()
    assert carriage.reason == "faces on 3 sides leave y free with 3 mm of air; 2 equal pairs"
    rail = motions["left_beam", "left_rail"]
    assert (rail.likely, rail.reason) == ("bonded", "2 screws or pins hold on to both")


@pytest.mark.process
@pytest.mark.workers
def test_a_worker_process_reports_progress_and_names_a_file_that_is_gone(
    small: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(strangers, "call_apart", call_apart)
    monkeypatch.setattr(isolation, "PROGRESS_SECONDS", 0.02)
    texts: list[str] = []
    assert len(find_contacts(small, progress=texts.append)) == 8
    assert set(texts) <= {f"{i}/6" for i in range(1, 7)}
    assert texts
    gone = dataclasses.replace(small, path=small.path.with_name("gone.step"))
    with pytest.raises(MeshError, match=r"no file .*gone\.step"):
        find_contacts(gone)


@pytest.mark.trials
@pytest.mark.parametrize("tolerance", [0.15e-3, 0.25e-3])
def test_all_63_contacts_of_a_frame_of_38_solids_and_no_other(
    tmp_path: Path, tolerance: float
) -> None:
    frame = write_frame(tmp_path / "frame.step", build_frame)
    assembly = survey_assembly(tmp_path / "frame.step", trial_seconds=0.0)
    assert len(assembly.solids) == 38
    assert len(frame.contacts) == 63
    assert_expected(frame, find_contacts(assembly, tolerance=tolerance))


@pytest.mark.trials
def test_8_of_8_carriages_guide_with_air_and_without(tmp_path: Path) -> None:
    places = (75.0, 150.0, 225.0, 325.0)
    frame = write_frame(tmp_path / "frame.step", lambda: build_frame(places))
    assembly = survey_assembly(tmp_path / "frame.step", trial_seconds=0.0)
    contacts = find_contacts(assembly)
    assert_expected(frame, contacts)
    names = {number: name for name, number in frame.numbers().items()}
    motions = find_pair_motions(assembly, contacts)
    guides = {
        tuple(names[number] for number in one.solids) for one in motions if one.likely == "guide"
    }
    assert guides == {
        (f"{side}_rail", f"{side}_carriage_{i}") for side in ("left", "right") for i in (1, 2, 3, 4)
    }
