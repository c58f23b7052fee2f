"""Machines from scene files, without what computes them."""

from collections.abc import Mapping
from pathlib import Path

from headstock.arguments import (
    read_keys,
    read_name,
    read_path_argument,
)
from headstock.machine import Machine, write_settings
from headstock.pipeline.storage.provenance import SceneChoice

type Source = Machine | str | Path  # a machine, or the path of a scene file


def load(
    path: str | Path,
    *,
    variant: str | None = None,
    set: Mapping[str, object] | None = None,
    accept_defaults: bool = False,
) -> Machine:
    """Load a machine from a scene file.

    Args:
        path: A ``.toml`` file.
        variant: One of its variants, or several joined by ``+``.
        set: Dotted key to value, applied after the variant; numbers are in SI units.
        accept_defaults: Use the defaults of open values, which are errors otherwise; results name them.

    Raises:
        SceneError: Anything is wrong; ``problems`` has every problem with file, line, key and
            remedy.
    """
    if variant is not None:
        read_name(variant, "load", "variant")
    accepted = {"accept_defaults": True} if accept_defaults else {}
    settings = write_settings({**read_keys(set, "load", "set"), **accepted})
    return Machine.load(
        SceneChoice(read_path_argument(path, "load", "path"), variant, tuple(settings))
    )


def take_machine(source: Source, function: str, *, accept_defaults: bool = False) -> Machine:
    """Return the machine that a function is given; not public.

    Args:
        accept_defaults: Of a file, for what computes nothing.
    """
    return (
        source
        if isinstance(source, Machine)
        else load(read_path_argument(source, function, "machine"), accept_defaults=accept_defaults)
    )
