"""The process that shows how a long stage goes on while the follow_parent one computes: a bar on a terminal,
plain lines elsewhere.

It is run as a file and knows only the standard library, so that it starts in a few hundredths of a
second. A process and not a thread, because a factorisation keeps Python's lock for minutes. It
reads ``SECONDS<tab>LABEL`` when a stage begins (zero seconds: no estimate) and an empty line when
it ended, and answers that with one byte once its bar is gone. It ends with its parent.
"""

import os
import select
import signal
import sys
import time

FIRST_SECONDS = {"bar": 1.0, "lines": 15.0}
NEXT_SECONDS = {"bar": 0.2, "lines": 30.0}
WIDTH = 28
CLEAR = "\r\x1b[K"


def _render_bar(label: str, elapsed: float, expected: float, columns: int) -> str:
    """One line for a terminal; the bar creeps on, never full, when a stage takes longer than was
    expected.

    Args:
        elapsed: Since it began [s].
        expected: Estimate for all of it [s]; zero for none.
    """
    text = f"  {label:<26} "
    if expected > 0.0:
        ratio = elapsed / expected
        filled = int(WIDTH * (0.9 * ratio if ratio < 1.0 else 1.0 - 0.1 / ratio))
        text += f"{'━' * filled}{'─' * (WIDTH - filled)} {elapsed:5.0f} s"
        late = f", longer than the {expected:.0f} s expected"
        text += f" of about {expected:.0f} s" if ratio < 1.0 else late
    else:
        text += f"{elapsed:5.0f} s"
    return text[: max(1, columns - 1)]


def _render_line(label: str, elapsed: float, expected: float) -> str:
    """One line for a log.

    Args:
        elapsed: Since it began [s].
        expected: Estimate for all of it [s]; zero for none.
    """
    said = "about" if elapsed < expected else "longer than the"
    about = f", {said} {expected:.0f} s expected" if expected > 0.0 else ""
    return f"  {label:<26} for {elapsed:.0f} s{about}"


class _Renderer:
    """What is shown, and when next."""

    def __init__(self, kind: str, time_scale: float) -> None:
        self.kind = kind
        self.first, self.next = time_scale * FIRST_SECONDS[kind], time_scale * NEXT_SECONDS[kind]
        self.label, self.expected, self.begun, self.drawn = "", 0.0, 0.0, False
        self.due: float | None = None

    def begin(self, expected: float, label: str) -> None:
        """A stage begins."""
        self.label, self.expected, self.begun = label, expected, time.monotonic()
        self.due = self.begun + self.first

    def wait(self) -> float | None:
        """Seconds until something is to be shown; None for ever."""
        return None if self.due is None else max(0.0, self.due - time.monotonic())

    def show(self) -> None:
        """Show how far it is, when it is time to."""
        now = time.monotonic()
        if self.due is None or now < self.due:
            return
        self.due = now + self.next
        if self.kind == "lines":
            write(_render_line(self.label, now - self.begun, self.expected) + "\n")
            return
        self.drawn = True
        write(CLEAR + _render_bar(self.label, now - self.begun, self.expected, _terminal_columns()))

    def end(self) -> None:
        """The stage ended: take the bar away."""
        self.due = None
        if self.drawn:
            write(CLEAR)
            self.drawn = False


def write(text: str) -> None:
    """Write to standard output, whole and at once."""
    os.write(1, text.encode("utf-8", "replace"))


def _terminal_columns() -> int:
    """Width of the terminal."""
    try:
        return os.get_terminal_size(1).columns or 80
    except OSError:
        return 80


def follow_parent(arguments: list[str]) -> int:
    """Follow the parent's words.

    Args:
        arguments: ``bar`` or ``lines``, the number of the open file that takes the answers, and a
            factor on all waiting times.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    renderer, answers = _Renderer(arguments[0], float(arguments[2])), int(arguments[1])
    waiting = b""
    while True:
        if not select.select([0], [], [], renderer.wait())[0]:
            renderer.show()
            continue
        read = os.read(0, 4096)
        if not read:
            renderer.end()
            return 0
        *lines, waiting = (waiting + read).split(b"\n")
        for line in lines:
            if line:
                seconds, _, label = line.decode("utf-8", "replace").partition("\t")
                renderer.begin(float(seconds), label)
            else:
                renderer.end()
                os.write(answers, b".")


if __name__ == "__main__":
    try:
        sys.exit(follow_parent(sys.argv[1:]))
    except OSError:
        sys.exit(1)  # nobody looks any more
