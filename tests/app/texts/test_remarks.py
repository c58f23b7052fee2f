"""Remarks that differ in numbers only are one line with their count."""

from headstock.app.texts.remarks import fold_remarks


def test_remarks_that_differ_in_numbers_are_counted() -> None:
    stiff = [f"joint pad_{n}, x: {n}.5e+08 is 1.{n}e+10 times as stiff" for n in range(1, 5)]
    others = ["component 'bed': a mesh of 3 nodes", "nothing holds C rotation of rotor"]
    assert fold_remarks([others[0], *stiff, others[1]]) == [
        others[0],
        f"{stiff[0]} (3 more like this: pad_2, pad_3, pad_4)",
        others[1],
    ]


def test_few_remarks_and_remarks_with_other_words_stay() -> None:
    few = ["mode 3 is off by 2 %", "mode 4 is off by 5 %"]
    named = [f"component {name!r}: 3 cells" for name in ("bed", "head", "table")]
    assert fold_remarks([*few, *named]) == [*few, *named]
    assert fold_remarks([f"mode {n} is off by 2 %" for n in range(3)]) == [
        "mode 0 is off by 2 % (2 more like this, with other numbers)"
    ]
