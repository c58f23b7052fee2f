"""Chains of masses and springs along one direction: their schema, and the point masses and joints
they stand for.
"""

from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from headstock.geometry.parts.solids import CENTER_FACE
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings
from headstock.scene.schema.types import (
    Direction,
    End,
    LossFactor,
    NotNegativeDamping,
    Position,
    PositiveMass,
    PositiveStiffness,
    StrictTable,
    problem,
)

CHAINS = "chains"
MOST_MASSES = 200


class ChainTable(StrictTable):
    """Point masses in a row that move along one direction, each on a spring to the one before.

    The mass `NAME_1` is the first, `NAME_spring_1` the spring before it.
    """

    origin: Annotated[End, Field(alias="from")]
    to: End | None = None
    axis: Direction
    at: Position | None = None
    masses: Annotated[list[PositiveMass], Field(min_length=1, max_length=MOST_MASSES)]
    stiffness: Annotated[list[PositiveStiffness], Field(min_length=1, max_length=MOST_MASSES + 1)]
    damping: list[NotNegativeDamping] = []
    loss_factor: LossFactor = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        springs = len(self.masses) + (self.to is not None)
        where = "one before each mass" + (" and one to the other end" if self.to else "")
        for name, values in (("stiffness", self.stiffness), ("damping", self.damping)):
            if len(values) != springs and (values or name == "stiffness"):
                raise problem(f"has {len(values)} entries of {name} for {springs} springs: {where}")
        ends = [end for end in (self.origin, self.to) if end is not None]
        if self.at is None and any(end.component is not None for end in ends):
            raise problem(
                'begins or ends at a component; write where its masses are: at = ["0 mm", "0 mm", "250 mm"]'
            )
        return self


def expand_chains(full: TomlTable, findings: Findings) -> None:
    """Add the components and joints of every chain to those of a scene; what is wrong with a chain
    is left to the schema.

    Args:
        full: A scene with calculated values.
        findings: Receives problems, and where each entry was written.
    """
    chains = full.get(CHAINS)
    for name, chain in chains.items() if isinstance(chains, dict) else ():
        try:
            table = ChainTable.model_validate(chain)
        except ValidationError:
            continue
        if not isinstance(chain, dict):
            continue
        for section, made in _list_parts(name, chain, table).items():
            entries = full.get(section, {})
            if not isinstance(entries, dict):
                continue
            for own in made.keys() & entries.keys():
                findings.add(
                    (section, own),
                    f"chains.{name} makes an entry of this name too; rename one of them",
                )
            for own in made:
                findings.written_at[(section, own)] = (CHAINS, name)
            full[section] = entries | made


def list_members(tables: TomlTable) -> dict[str, list[str]]:
    """Names of the components and joints that the chains of a scene make, as far as they can be
    told.
    """
    found: dict[str, list[str]] = {"components": [], "joints": []}
    chains = tables.get(CHAINS)
    for name, chain in chains.items() if isinstance(chains, dict) else ():
        for section, key, form in (
            ("components", "masses", "{}_{}"),
            ("joints", "stiffness", "{}_spring_{}"),
        ):
            written = chain.get(key) if isinstance(chain, dict) else None
            count = len(written) if isinstance(written, list) else 0
            found[section] += [form.format(name, number + 1) for number in range(count)]
    return found


def _list_parts(name: str, chain: TomlTable, table: ChainTable) -> dict[str, TomlTable]:
    """Components and joints as a scene has them: prismatic joints between masses, which leave each
    the one motion, and a spring to the other end.
    """
    written = chain["stiffness"], chain["masses"], chain.get("damping")
    springs, masses, dampers = (value if isinstance(value, list) else [] for value in written)
    shared = {key: chain[key] for key in ("axis", "loss_factor") if key in chain}
    components: TomlTable = {}
    joints: TomlTable = {}
    before = chain["from"]
    for number, stiffness in enumerate(springs):
        last = number == len(masses)
        own = f"{name}_{number + 1}"
        end = chain["to"] if last else f"{own}.{CENTER_FACE}"
        if not last:
            placed = {} if table.at is None else {"at": chain["at"]}
            components[own] = {"solid": {"point_mass": masses[number]}, **placed}
        joints[f"{name}_spring_{number + 1}"] = {
            "between": [before, end],
            "kind": "spring" if last else "prismatic",
            "stiffness": {"x": stiffness},
            **({"damping": {"x": dampers[number]}} if dampers else {}),
            **shared,
        }
        before = end
    return {"components": components, "joints": joints}
