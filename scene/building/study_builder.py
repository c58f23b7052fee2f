"""From validated tables to studies."""

from headstock.scene.schema.studies import FamilyTable, StudyTable
from headstock.scene.studies import TRUTH, VARIANT, Study, StudyFamily


def build_study(name: str, table: StudyTable) -> Study:
    """The study a faultless table stands for; what it sets itself holds in each of its families unless they set it too."""
    families = [_build_family(key, family, table) for key, family in table.families.items()]
    if table.vary is not None:
        vary = {key: tuple(values) for key, values in table.vary.items()}
        families = [StudyFamily("", name, dict(table.set), vary, table.pairwise, tuple(table.analyses or ()))]
    if table.truth is not None:
        settings = {key: value for key, value in {**table.set, **table.truth}.items() if key != VARIANT}
        vary = {VARIANT: (str(table.truth[VARIANT]),)} if VARIANT in table.truth else {}
        # last: what it needs of memory would hide what the others need where a process cannot forget its peak
        families.append(StudyFamily(TRUTH, "held against", settings, vary, analyses=tuple(table.analyses or ())))
    return Study(
        name=name,
        families=tuple(families),
        watch=tuple(table.watch or ()),
        cold=table.store == "cold",
        repeats=table.repeats,
        reference=table.reference,
        truth=table.truth,
    )


def _build_family(name: str, family: FamilyTable, table: StudyTable) -> StudyFamily:
    return StudyFamily(
        name=name,
        label=family.label or name.replace("_", " "),
        settings={**table.set, **family.set},
        vary={key: tuple(values) for key, values in family.vary.items()},
        pairwise=family.pairwise or table.pairwise,
        analyses=tuple(family.analyses or table.analyses or ()),
        other_model=family.other_model,
    )
