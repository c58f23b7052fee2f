"""The tree of products in a STEP file's text, and texts that are cut, twisted or made to do harm."""

import contextlib
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common import approx
from headstock.meshing.assemblies import step_tree
from headstock.meshing.assemblies.step_tree import decode_string, read_tree
from headstock.meshing.errors import PartFileError


def product(number: int, name: str, formation: str = "PRODUCT_DEFINITION_FORMATION") -> str:
    """A product whose definition has a number; its other entities follow it."""
    source = ",.NOT_KNOWN." if formation.endswith("SOURCE") else ""
    return (
        f"#{number} = PRODUCT_DEFINITION('design','',#{number + 1},#9);\n"
        f"#{number + 1}={formation}('','',#{number + 2}{source});\n"
        f"#{number + 2} = PRODUCT ( 'id {name}' , '{name}' , '' , ( #8 ) ) ;\n"
        f"#{number + 3} = PRODUCT_DEFINITION_SHAPE('','',#{number});\n"
        f"#{number + 4} = SHAPE_DEFINITION_REPRESENTATION(#{number + 3},#{number + 5});\n"
    )


def use(number: int, parent: int, child: int, name: str = "", *, backwards: bool = False) -> str:
    """An occurrence that turns its product by a quarter about z."""
    ends = (parent + 5, child + 5) if backwards else (child + 5, parent + 5)
    frames = ("#9001", "#9002") if not backwards else ("#9002", "#9001")
    return (
        f"#{number} = NEXT_ASSEMBLY_USAGE_OCCURRENCE('{number}','{name}','',#{parent},#{child},$);\n"
        f"#{number + 1} = PRODUCT_DEFINITION_SHAPE('','',#{number});\n"
        f"#{number + 2} = (REPRESENTATION_RELATIONSHIP('','',#{ends[0]},#{ends[1]})\n"
        f" REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{number + 3})\n"
        f" SHAPE_REPRESENTATION_RELATIONSHIP());\n"
        f"#{number + 3} = ITEM_DEFINED_TRANSFORMATION('','',{frames[0]},{frames[1]});\n"
        f"#{number + 4} = CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{number + 2},#{number + 1});\n"
    )


FRAMES = (
    "#9001 = AXIS2_PLACEMENT_3D('',#9000,$,$);\n#9002 = AXIS2_PLACEMENT_3D('',#9000,#9003,#9004);\n"
    "#9003 = DIRECTION('',(0.,0.,2.));\n#9004 = DIRECTION('',(0.,1.,\n0.E+000));\n"
)
QUARTER = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]


def text_of(*entities: str) -> bytes:
    body = "".join(entities)
    return f"ISO-10303-21;\nDATA;\n{FRAMES}{body}ENDSEC;\nEND-ISO-10303-21;\n".encode()


NESTED = (
    product(10, "machine"),
    product(20, "carriage", "PRODUCT_DEFINITION_FORMATION_WITH_SPECIFIED_SOURCE"),
    product(30, "screw; it''s #7=PRODUCT(1)"),
    use(110, 10, 20, "left"),
    use(120, 10, 20),
    use(130, 20, 30, "screw", backwards=True),
)


def test_occurrences_are_opened_out_with_their_rotations() -> None:
    tree = read_tree(text_of(*NESTED), "a.step")
    screw = "screw; it's #7=PRODUCT(1)"
    assert tree.labels == ["machine", "left", "screw", "120", "screw"]
    assert tree.products == ["machine", "carriage", screw, "carriage", screw]
    assert tree.parents == [-1, 0, 1, 0, 3]
    assert tree.definitions == [10, 20, 30, 20, 30]
    assert tree.rotations[0] == approx(np.eye(3), abs=1e-9)
    assert tree.rotations[1] == approx(np.array(QUARTER), abs=1e-9)
    assert tree.rotations[2] == approx(np.diag([-1.0, -1.0, 1.0]), abs=1e-9)
    assert tree.broken == 0
    assert tree.arrays()["rotations"].shape == (5, 3, 3)


@pytest.mark.parametrize(
    ("coded", "text"),
    [
        (rb"'it''s'", "it's"),
        (rb"'Gr\X2\00FC\X0\n'", "Grün"),
        (rb"'\X2\00D800E9\X0\'", "Øé"),
        (rb"'\X4\0001F600\X0\ \X\E4'", "\U0001f600 ä"),
        (rb"'\S\d a\\b'", "ä a\\b"),
        ("'Träger'".encode(), "Träger"),
        ("'Träger'".encode("latin-1"), "Träger"),
        (b"'cut in\n two'", "cut in two"),
        (b"'\x1b[31mred'", "?[31mred"),
        (rb"'\X2\00F\X0\'", ""),
        (rb"'\X2\D800\X0\'", "?"),
    ],
)
def test_strings_are_decoded(coded: bytes, text: str) -> None:
    assert decode_string(coded).replace("\ufffd", "?") == text


def test_references_to_nothing_are_counted_and_left_out() -> None:
    tree = read_tree(text_of(*NESTED, use(140, 10, 77), use(150, 5, 10)), "a.step")
    assert tree.broken == 2
    assert len(tree.labels) == 5
    lone = NESTED[3].replace("#9002", "#9009")
    tree = read_tree(text_of(*NESTED[:2], lone), "a.step")
    assert np.isnan(tree.rotations[1]).all()


@pytest.mark.parametrize(
    ("entities", "message"),
    [
        ([*NESTED, use(140, 30, 10)], 'a product contains itself ("'),
        ([product(10, "ring"), use(110, 10, 10)], 'contains itself ("ring", in "ring")'),
        (
            [product(10 * i, f"p{i}") for i in range(1, 46)]
            + [use(1000 + 10 * i, 10 * i, 10 * i + 10) for i in range(1, 45)],
            "nests them more than 40 deep",
        ),
        (
            [product(10 * i, f"p{i}") for i in range(1, 31)]
            + [
                use(1000 + 10 * i + 5 * j, 10 * i, 10 * i + 10)
                for i in range(1, 30)
                for j in (0, 1)
            ],
            "more than 20000 occurrences",
        ),
    ],
)
def test_trees_without_end_are_refused(entities: list[str], message: str) -> None:
    before = time.process_time()
    with pytest.raises(PartFileError, match=r"^a\.step") as caught:
        read_tree(text_of(*entities), "a.step")
    assert message in str(caught.value)
    assert time.process_time() - before < 2.0


def test_a_file_that_is_cut_off_is_named() -> None:
    text = text_of(*NESTED)
    for length in (0, 20, len(text) // 2, len(text) - 12):
        with pytest.raises(PartFileError, match=r"a\.step is cut off"):
            read_tree(text[:length], "a.step")


def test_too_many_entities_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_tree, "MOST_ENTITIES", 10)
    with pytest.raises(PartFileError, match="more than 10 entities"):
        read_tree(text_of(*NESTED), "a.step")


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_damaged_texts_give_a_tree_or_one_named_error(data: st.DataObject) -> None:
    text = bytearray(text_of(*NESTED))
    for _ in range(data.draw(st.integers(1, 6))):
        start = data.draw(st.integers(0, len(text)))
        cut = data.draw(st.integers(0, 40))
        piece = data.draw(
            st.sampled_from(
                [b"", b"'", b"(", b")", b";", b"#10", b"#999999999", b"$", b"\xff", b"\\X2\\"]
            )
        )
        text[start : start + cut] = piece
    text += b"\nEND-ISO-10303-21;"
    with contextlib.suppress(PartFileError):
        tree = read_tree(bytes(text), "a.step")
        assert len(tree.labels) == len(tree.rotations) == len(tree.arrays()["parents"])


def test_texts_that_make_searches_slow_are_read_in_linear_time() -> None:
    for filler in (
        b"#1=PRODUCT('",
        b"#1=PRODUCT((",
        b"''",
        b"(REPRESENTATION_RELATIONSHIP(",
        b"# ",
    ):
        before = time.process_time()
        read_tree(b"DATA;" + filler * 2000 + b"END-ISO-10303-21;", "a.step")
        assert time.process_time() - before < 1.0
