"""The table of hard cases: what each test asserted and what it found, written from the assertions themselves.

``./headstock test -n 0 -o enable_assertion_pass_hook=true tests/hard_cases --hard-case-table docs/hard_cases.md``
"""

import ast
import linecache
import operator
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SIGNS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
ARITHMETIC = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
SHOWN, LONGEST = 2, 110
APPROXIMATE = re.compile(rf"Obtained: (?:np\.\w+\()?({NUMBER})\)?\s+Expected: (?:np\.\w+\()?({NUMBER})\)? ± ({NUMBER})")
INTRODUCTION = """# Hard cases

Cases that were seen to break programs like this one, each with the tests that hold it here. The table is written by the assertions of
the tests: a claim is the name of a test, a check is a line of it with a number on either side, *found* is the number closest to its
bound over all its repetitions. A test that compares texts or asks for an error shows what it asks for instead.

    ./headstock test -n 0 -o enable_assertion_pass_hook=true tests/hard_cases --hard-case-table docs/hard_cases.md

"""


@dataclass
class Claim:
    """What one test asserted, over all its parameters: its checks with numbers, and those without."""

    checks: dict[str, tuple[float, str, float]] = field(default_factory=dict)
    texts: list[str] = field(default_factory=list)
    runs: int = 0

    def add(self, source: str, explanation: str) -> None:
        bound = _read_bound(explanation.splitlines()[0])
        near = APPROXIMATE.search(explanation)
        if bound is not None:
            self.hold(source, *bound)
        elif near is not None:
            self.hold(source, abs(float(near[1]) - float(near[2])), "<=", float(near[3]))
        elif source not in self.texts:
            self.texts.append(source)

    def hold(self, source: str, found: float, sign: str, bound: float) -> None:
        if source not in self.checks or _room(found, sign, bound) < _room(*self.checks[source]):
            self.checks[source] = (found, sign, bound)


def pytest_addoption(parser):
    parser.addoption("--hard-case-table", type=Path, help="write the table of hard cases to this Markdown file")


def pytest_configure(config):
    if config.getoption("--hard-case-table", None) is None:
        return
    if not config.getini("enable_assertion_pass_hook"):
        raise pytest.UsageError("the table needs what assertions found: add -n 0 -o enable_assertion_pass_hook=true")
    # compiled tests kept from other runs do not tell what they found
    sys.pycache_prefix = str(config.rootpath / ".pytest_cache" / "telling")
    config.stash[CLAIMS] = {}


def pytest_assertion_pass(item, orig, expl):
    claims = item.config.stash.get(CLAIMS, None)
    if claims is not None:
        claims.setdefault(_key(item.nodeid), Claim()).add(orig, expl)


@pytest.fixture(autouse=True)
def told_deviations(request, monkeypatch):
    """While the table is made, ``assert_allclose`` says how far apart its two sides were."""
    claims = request.config.stash.get(CLAIMS, None)
    if claims is None:
        return
    compare = np.testing.assert_allclose

    def compare_and_tell(actual, desired, rtol=1e-7, atol=0.0, **options):
        compare(actual, desired, rtol=rtol, atol=atol, **options)
        caller = sys._getframe(1)
        source = linecache.getline(caller.f_code.co_filename, caller.f_lineno).strip()
        claim = claims.setdefault(_key(request.node.nodeid), Claim())
        apart = np.abs(np.asarray(actual) - np.asarray(desired)).ravel()
        if not rtol:
            claim.hold(source, float(apart.max(initial=0.0)), "<=", float(np.max(atol)))
            return
        scale = np.broadcast_to(np.abs(desired), np.shape(actual)).ravel() + atol / rtol
        claim.hold(source, float((apart[apart > 0.0] / scale[apart > 0.0]).max(initial=0.0)), "<=", rtol)

    monkeypatch.setattr(np.testing, "assert_allclose", compare_and_tell)


def pytest_runtest_logreport(report):
    # a plugin cannot be had from a report, so the outcome is kept beside the claims when the session ends
    if report.when == "call" and report.passed:
        PASSED.append(report.nodeid)


def pytest_sessionfinish(session, exitstatus):
    claims = session.config.stash.get(CLAIMS, None)
    if claims is None:
        return
    if exitstatus != 0:
        return  # what failed is told by pytest, and no table is written
    for nodeid in PASSED:
        claims.setdefault(_key(nodeid), Claim()).runs += 1
    titles = {Path(item.path).name: ast.get_docstring(ast.parse(Path(item.path).read_text())) for item in session.items}
    session.config.getoption("--hard-case-table").write_text(write_table(claims, titles))


def write_table(claims, titles):
    """The table as Markdown, one heading per case."""
    lines, files = [INTRODUCTION], sorted(titles)
    for name in files:
        lines.append(f"## {titles[name].splitlines()[0]}\n")
        lines.append(f"`tests/hard_cases/{name}`\n\n| claim | check | found |\n| --- | --- | --- |")
        lines += [row for (file, test), claim in claims.items() if file == name for row in _rows(test, claim)]
        lines.append("")
    return "\n".join(lines)


def _rows(test, claim):
    title = test.removeprefix("test_").replace("_", " ") + (f" ({claim.runs} times)" if claim.runs > 1 else "")
    checks = [(source, f"{found:.3g} {sign} {bound:.3g}") for source, (found, sign, bound) in claim.checks.items()]
    checks = checks or [(source, "holds") for source in claim.texts[:SHOWN]] or [("an error that says so", "raised")]
    rows = []
    for source, found in checks:
        short = " ".join(source.split()).removeprefix("np.testing.").replace("|", "\\|")
        rows.append(f"| {title} | `{short[:LONGEST]}` | {found} |")
        title = ""
    return rows


def _read_bound(line):
    """The two sides of a comparison that an assertion spelled out, ``np.float64(2e-9) < (1e-9 * 7.0)``, or None."""
    try:
        tree = ast.parse(line.strip(), mode="eval").body
        if not isinstance(tree, ast.Compare) or len(tree.ops) != 1 or type(tree.ops[0]) not in SIGNS:
            return None
        return _number(tree.left), SIGNS[type(tree.ops[0])], _number(tree.comparators[0])
    except (SyntaxError, ValueError):
        return None


def _number(node):
    if isinstance(node, ast.Call) and len(node.args) == 1:
        return _number(node.args[0])  # np.float64(...)
    if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        return ARITHMETIC[type(node.op)](_number(node.left), _number(node.right))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_number(node.operand)
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        return float(node.value)
    raise ValueError("no number")


def _room(found, sign, bound):
    """How far a number is from its bound, as a ratio: the smaller, the closer."""
    room = bound - found if sign.startswith("<") else found - bound
    return room / max(abs(bound), abs(found), 1e-300)


def _key(nodeid):
    file, test = nodeid.split("::", 1)
    return Path(file).name, test.split("[")[0].split("::")[-1]


CLAIMS = pytest.StashKey[dict[tuple[str, str], Claim]]()
PASSED: list[str] = []
