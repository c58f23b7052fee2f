"""``headstock correlate``: a measured machine beside its model, as tables, figures, a page and targets of a
fit.
"""

from pathlib import Path

from headstock.app.actions.running import claim_on_root, require_ranks, stage_progress
from headstock.app.charts.correlation import draw_correlation
from headstock.app.commands.batch_commands import CorrelateOptions
from headstock.app.commands.options import read_percent
from headstock.app.report.pages import render_correlation
from headstock.app.tables.correlation import list_tables
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import print_remarks
from headstock.app.terminal.correlation import print_correlation
from headstock.app.terminal.guard import DONE
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import write_named_files, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.correlation.job import CorrelationJob, load_correlation, run_correlation
from headstock.studies.correlation.summary import summarise_correlation

PAGE_FILE, JSON_FILE = "correlate.html", "correlate.json"


def correlate_command(options: CorrelateOptions, comm: MPI.Comm) -> int:
    """Compute the machine of a test on all ranks, print what agrees and write the files.

    Raises:
        SceneError: The scene has problems.
        MeasurementError: The test file has.
        click.UsageError: An option does not fit.
        HeadstockError: A computation or a file failed.
    """
    origin = options.trace(comm.size)
    require_ranks(options.ranks, comm)
    job = CorrelationJob(
        options.chosen,
        options.test,
        options.pose,
        read_percent(options.within),
        options.expansion,
        options.like,
    )
    loaded = make_on_root(comm, lambda: load_correlation(job))
    folder = options.output or Path("results") / f"{options.scene.stem}-{options.test.stem}"
    with claim_on_root(comm, folder, (JSON_FILE, PAGE_FILE)):
        with stage_progress(comm) as (announce, observe):
            found = run_correlation(
                loaded, Store(default_store_root()), comm, announce=announce, observer=observe
            )

        def publish() -> int:
            if found is not None:
                _publish(found, folder, options, origin)
            return DONE

        return make_on_root(comm, publish)


def _publish(
    found: Correlation, folder: Path, options: CorrelateOptions, origin: Provenance | None
) -> None:
    figures = draw_correlation(found)
    tables = {
        f"{listing.name}.csv": encode_csv(listing.tabulate()) for listing in list_tables(found)
    }
    pictures = {f"{name}.png": image for name, image in figures.items()}
    fit = {name: text.encode() for name, text in found.fit_files.items()}
    remarks = write_named_files(folder, pictures | tables | fit)
    summary = summarise_correlation(found)
    described = None if origin is None else origin.summarise()
    text = dump_summary({**summary, **({"provenance": described} if described else {})})
    write_output(folder / JSON_FILE, text.encode())
    write_output(folder / PAGE_FILE, render_correlation(found, figures, described).encode())
    options.write_json(text)
    print_correlation(found, folder, [PAGE_FILE, JSON_FILE, *tables, *pictures, *fit])
    print_remarks(remarks)
