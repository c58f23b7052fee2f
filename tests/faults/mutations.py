"""Random damage to texts and files, as hands, disks and attackers do it."""

import random
import re

NASTY_VALUES = (
    "nan", "-inf", "+inf", "1e400", "-1e-400", "0", "-1", "9" * 5000, "0x" + "f" * 300, "1979-05-27T07:32:00Z", "true", "[]", "{}", '""',
    '"1e400 mm"', '"-5 mm"', '"nan mm"', '"1e3"', '"1 GPa/GPa"', '"1 mm**9**9**9"', '"9**9**9 m"', '"1 kg^999999999"', '"(1+2) mm"',
    '"__import__(\'os\').system(\'true\') m"', '"1 µm"', '"１２ mm"', '"\\u0000"', '"1 mm\\n"', '"../../../etc/passwd"', '"/dev/zero"', '"x.geo"',
    '"ground"', '"."', '"column."', '["1 mm"]', '["1 mm", "1 mm", "1 mm"]', "[[[[[[[[[[[[]]]]]]]]]]]]", "{ a = { b = { c = 1 } } }", "1e-300",
    '"1e-300 mm"', '"1e300 GPa"', '"0 mm"', '"rigid"', '"elastic"', '"average"', "10000000", "-9223372036854775808", '"segmented"',
    '"1 mm" # "', "'''\n'''", '"""\n"""', '"' + "a" * 5000 + '"', '"1 ' + "m*" * 3000 + 'm"', '"1 ' + "k" * 500 + 'm"', '"' + "9" * 390 + ' mm"',
)  # fmt: skip
CHARACTERS = ("", *"\"'[]{}=.,\n\t\0\\#é\U0001f600")
_VALUE = re.compile(r"(?<== )[^=\n#]+|(?<=[\[,] )[^\],\n]+")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_NUMBER = re.compile(rb"-?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?")
NASTY_NUMBERS = (
    *(b"1000000000000", b"-1", b"0", b"nan", b"1e400", b"4294967296", b"9223372036854775807"),
    *(b"99999999999999999999", b"", b"x"),
)


def mutate_text(text: str, others: tuple[str, ...], chance: random.Random) -> str:
    """A scene text after one to five random changes to its values, words, lines and characters."""
    for _ in range(chance.choice((1, 1, 1, 2, 3, 5))):
        text = chance.choice(_TEXT_CHANGES)(text, others, chance)
    return text


def mutate_bytes(content: bytes, chance: random.Random) -> bytes:
    """The content of a file after one to four random kinds of damage."""
    for _ in range(chance.choice((1, 1, 2, 4))):
        content = chance.choice(_BYTE_CHANGES)(content, chance)
    return content


def _replace_value(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    return _replace_match(_VALUE, text, chance.choice(NASTY_VALUES), chance)


def _swap_values(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    found = _VALUE.findall(text)
    return _replace_match(_VALUE, text, chance.choice(found), chance) if found else text


def _replace_word(text: str, others: tuple[str, ...], chance: random.Random) -> str:
    found = _WORD.findall(chance.choice((text, *others)))
    return _replace_match(_WORD, text, chance.choice(found), chance) if found else text


def _scale_number(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    return _replace_match(
        re.compile(r"\d+"), text, f"{chance.randrange(10)}e{chance.randrange(-40, 40)}", chance
    )


def _drop_line(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    if lines:
        del lines[chance.randrange(len(lines))]
    return "".join(lines)


def _insert_line(text: str, others: tuple[str, ...], chance: random.Random) -> str:
    lines, source = (
        text.splitlines(keepends=True),
        chance.choice((text, *others)).splitlines(keepends=True),
    )
    start = chance.randrange(len(source)) if source else 0
    place = chance.randint(0, len(lines))
    return "".join(
        [*lines[:place], *source[start : start + chance.choice((1, 1, 3, 10))], *lines[place:]]
    )


def _repeat_line(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    place = chance.randrange(len(lines))
    return "".join(
        [*lines[:place], lines[place] * chance.choice((2, 50, 1000)), *lines[place + 1 :]]
    )


def _change_characters(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    characters = list(text)
    for _ in range(chance.randint(1, 8)):
        place = chance.randint(0, len(characters))
        new = chance.choice((*CHARACTERS, chr(chance.randrange(1, 0xD7FF))))
        characters[place : place + chance.randint(0, 2)] = new
    return "".join(characters)


def _cut_text(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    return text[: chance.randint(0, len(text))]


def _nest_value(text: str, _others: tuple[str, ...], chance: random.Random) -> str:
    depth = chance.choice((5, 49, 60, 2000))
    left, right = chance.choice((("[", "]"), ("{a=", "}")))
    return _replace_match(_VALUE, text, left * depth + "1" + right * depth, chance)


def _replace_match(pattern: re.Pattern[str], text: str, new: str, chance: random.Random) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text
    match = chance.choice(found)
    return text[: match.start()] + new + text[match.end() :]


_TEXT_CHANGES = (
    _replace_value, _replace_value, _replace_value, _swap_values, _swap_values, _replace_word, _replace_word, _scale_number, _drop_line,
    _insert_line, _repeat_line, _change_characters, _cut_text, _nest_value,
)  # fmt: skip


def _flip_bits(content: bytes, chance: random.Random) -> bytes:
    damaged = bytearray(content)
    for _ in range(chance.choice((1, 3, 30))):
        if damaged:
            damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
    return bytes(damaged)


def _truncate(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randint(0, len(content))]


def _blank_span(content: bytes, chance: random.Random) -> bytes:
    start = chance.randint(0, len(content))
    length = min(chance.choice((1, 8, 512, 4096)), len(content) - start)
    return content[:start] + bytes(length) + content[start + length :]


def _drop_span(content: bytes, chance: random.Random) -> bytes:
    start = chance.randint(0, len(content))
    return content[:start] + content[start + chance.choice((1, 4, 100, 5000)) :]


def _move_span(content: bytes, chance: random.Random) -> bytes:
    start, length = chance.randint(0, len(content)), chance.choice((8, 100, 5000))
    place = chance.randint(0, len(content))
    return content[:place] + content[start : start + length] + content[place:]


def _lie_about_number(content: bytes, chance: random.Random) -> bytes:
    start = chance.randint(0, len(content)) if chance.random() < 0.7 else 0
    match = _NUMBER.search(content, start)
    return (
        content
        if match is None
        else content[: match.start()] + chance.choice(NASTY_NUMBERS) + content[match.end() :]
    )


_BYTE_CHANGES = (
    *(_flip_bits, _flip_bits, _truncate, _blank_span, _drop_span, _move_span),
    *(_lie_about_number, _lie_about_number),
)
