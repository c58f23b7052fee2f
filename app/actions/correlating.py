"""``headstock correlate`` and ``headstock modes``: a measured machine beside its model, as tables, figures, a page
and targets of a fit; and modes of a test alone.
"""

from pathlib import Path

from headstock.app.actions.running import claim_on_root, require_ranks, stage_progress
from headstock.app.charts.correlation import draw_correlation
from headstock.app.charts.stabilisation import draw_stabilisation
from headstock.app.commands.batch_commands import CorrelateOptions
from headstock.app.commands.options import read_percent
from headstock.app.commands.tool_commands import ModesOptions
from headstock.app.report.pages import render_correlation
from headstock.app.tables.correlation import list_correlation_tables
from headstock.app.tables.modal_fit import list_fitted_modes
from headstock.app.tables.table import encode_csv
from headstock.app.terminal.console import counted, make_console, print_remarks
from headstock.app.terminal.correlation import print_correlation
from headstock.app.terminal.guard import DONE
from headstock.app.terminal.progress import show_progress
from headstock.app.terminal.summary import print_part
from headstock.pipeline.storage.json_texts import dump_summary
from headstock.pipeline.storage.outputs import claim_output, write_named_files, write_output
from headstock.pipeline.storage.provenance import Provenance
from headstock.pipeline.storage.store import Store, default_store_root
from headstock.scene.test_data.reading import read_test_data
from headstock.scene.test_data.records import TestData
from headstock.scene.test_data.uff_writing import encode_uff
from headstock.solvers.mpi import MPI
from headstock.solvers.ranks import make_on_root
from headstock.studies.correlation.correlation import Correlation
from headstock.studies.correlation.job import CorrelationJob, load_correlation, run_correlation
from headstock.studies.correlation.modal_fit import ModalFit, read_modes
from headstock.studies.correlation.summary import summarise_correlation, summarise_fit

PAGE_FILE, JSON_FILE = "correlate.html", "correlate.json"
MODES_JSON, MODES_UFF, MODES_CSV = "modes.json", "modes.uff", "modes.csv"
DIAGRAM = "stabilisation.svg"


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
        f"{listing.name}.csv": encode_csv(listing.tabulate())
        for listing in list_correlation_tables(found)
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


def modes_command(options: ModesOptions) -> int:
    """Fit modes to a test, print and write them.

    Raises:
        MeasurementError: Something is wrong in the file, or it has nothing to fit.
        OutputError: The folder cannot be written.
    """
    folder = options.output or Path("results") / f"{options.test.stem}-modes"
    data = read_test_data(options.test)
    with claim_output(folder, (MODES_JSON, MODES_UFF, MODES_CSV, DIAGRAM)):
        with show_progress() as progress:

            def announce(text: str) -> None:
                progress.end()
                progress.begin(text)

            fit = read_modes(
                data,
                options.test.name,
                band=options.band_hz,
                order=options.order,
                references=options.names,
                progress=announce,
            )
        text, listing = dump_summary(summarise_fit(fit, options.test.name)), list_fitted_modes(fit)
        written = TestData(points=data.points, lines=data.lines, modes=fit.modes)
        files = {
            MODES_JSON: text.encode(),
            MODES_UFF: encode_uff(written, options.test.name),
            MODES_CSV: encode_csv(listing.tabulate()),
            DIAGRAM: draw_stabilisation(fit).encode(),
        }
        files = {name: content for name, content in files.items() if content}
        for name, content in files.items():
            write_output(folder / name, content)
        options.write_json(text)
        print_remarks([*data.remarks, *fit.remarks])
        print_part(make_console(), listing)
        _print_quality(fit, folder, list(files))
    return DONE


def _print_quality(fit: ModalFit, folder: Path, files: list[str]) -> None:
    """Say how well the responses are met, and where the files are."""
    console = make_console()
    count = counted(len(fit.modes.frequencies_hz), "mode")
    if fit.responses is None or fit.assurance is None:
        console.say(f"{count}, as the file has them")
    else:
        ends = f"{fit.responses.frequencies_hz[0]:.4g} to {fit.responses.frequencies_hz[-1]:.4g} Hz"
        worst = float(fit.assurance[fit.assurance == fit.assurance].min())
        console.say(
            f"{count} from {ends}; of the pair that is met worst, FRAC is {worst:.3f}; ± from "
            + ("noise that the test has" if fit.source == "noise" else "what the fit leaves over")
        )
    console.say(f"results in {folder} ({', '.join(files)})", style="bold")
