"""Displacement and stress at points of components under the static loads."""

from collections.abc import Iterator

from headstock.app.tables.probes import PROBE_COLUMNS, PROBE_MOTION_COLUMNS, PROBE_STRESS_COLUMNS
from headstock.app.tables.table import Listing
from headstock.app.views.view import FinishedRun, Section, View
from headstock.pipeline.answers.probes import ProbeSummary
from headstock.pipeline.results.mode_files import file_stem


def _list_poses(run: FinishedRun) -> Iterator[Listing[tuple[str, ProbeSummary]]]:
    for pose, probes in run.summary["probes"].items():
        title = f"Under the static loads in pose {pose}"
        yield Listing(title, PROBE_COLUMNS, probes.items(), f"probes_{file_stem(pose)}")


VIEW = View(
    tables=lambda run: (listing.tabulate() for listing in _list_poses(run)),
    terminal=_list_poses,
    section=Section(
        "probes",
        "Probes",
        template="views/probes.html",
        names={
            "columns": {
                "probe_motions": PROBE_MOTION_COLUMNS,
                "probe_stresses": PROBE_STRESS_COLUMNS,
            }
        },
    ),
)
