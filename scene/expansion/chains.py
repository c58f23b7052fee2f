"""The point masses and joints that chains of masses and springs along one direction stand for."""

from pydantic import ValidationError

from headstock.geometry.parts.solids import CENTER_FACE
from headstock.scene.reading.files import TomlTable
from headstock.scene.reading.findings import Findings
from headstock.scene.schema.chains import ChainTable

CHAINS = "chains"


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
    shared: TomlTable = {key: chain[key] for key in ("axis", "loss_factor") if key in chain}
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
