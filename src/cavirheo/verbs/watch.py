"""`cavirheo watch`: a folder in, each recording answered as it arrives; result.json and a page for the wall out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from cavirheo.errors import require
from cavirheo.verbs import options
from cavirheo.verbs.run import Reading, Run


def watch(
    folder: Annotated[Path, Argument(readable=False, help="where the recordings arrive: R(t) files or videos")],
    model: options.ModelName = "posterior",
    material: options.Material = None,
    column: options.Column = None,
    stretch: options.KnownStretch = None,
    window: options.ReadWindow = None,
    bubbles: options.Bubbles = options.FROM_OPTIONS,
    verify: options.VerifyAuto = "auto",
    exact_law: options.ExactLaw = False,
    seed: options.Seed = 0,
    once: Annotated[bool, Option("--once", help="answer the files that exist, write the report, and stop")] = False,
    patience: Annotated[float, Option(help="how long to try a file again that cannot be read, s", min=0.0)] = 10.0,
    wanted_percent: options.WantedPercent = 10.0,
    reading: Reading = options.FROM_OPTIONS,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-result"),
    pictures: options.Pictures = True,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Every recording that arrives in a folder, answered as `infer` does, until Ctrl-C."""
    from dataclasses import asdict

    from cavirheo.inference.analysis import Analysis
    from cavirheo.parallel import aside, cores
    from cavirheo.physics.simulate import load_solver
    from cavirheo.reading.column import is_size, read_column
    from cavirheo.reporting import wall_page, write_report
    from cavirheo.reporting.table import print_line, print_table
    from cavirheo.watch import Watch
    from cavirheo.writing import digits

    require(folder.is_dir(), f"{folder} is no folder: give the one where recordings arrive", "watch.folder")
    options.check_verify(verify, reading.exposure_us, exact_law, [folder])
    message = f"--rmax-um must be a positive radius in micrometres, got {reading.rmax_um}"
    require(reading.rmax_um is None or reading.rmax_um > 0, message, "option.rmax_um")
    known, trusted = options.known_stretch(stretch), reading.trust_input
    asked: Any = {"model": model, "material": material, "bubble": bubbles, "medium": liquid, "stretch": known}
    analysis = Analysis(
        **asked, window=window, trust_input=trusted, verify=verify, discrepancy=not exact_law, seed=seed
    )
    message = (
        "--exclude is of one recording: leave the frames out with `cavirheo measure`, and watch for what it writes"
    )
    require(reading.exclude is None, message, "option.exclude")
    if column is not None and not is_size(column):
        read_column(column)
    watching = Watch(
        folder, out, analysis, lambda path: reading.recordings([path], liquid), asdict(reading), group=reading.group,
        column=column, command=run.command, date=run.date, say=run.say, patience=patience, wanted=0.01 * wanted_percent,
        show=print_line if not run.quiet else lambda _: None,
    )  # fmt: skip
    aside(load_solver)
    result = watching.write()
    page = f"{out / wall_page.PAGE} shows the latest" + ("" if once else "; Ctrl-C ends")
    run.say(f"watching {folder}: {len(result.curves)} answered before; {page}")
    try:
        while watching.once() or watching.pause() or not once:
            pass
        stopped = False
    except KeyboardInterrupt:  # the usual end
        stopped = True
    pairs, notes = watching.answered()
    how: dict[str, Any] = {"date": run.date, "notes": notes, "draw": pictures, "workers": cores()}
    result = write_report(out, pairs, run.command, **how)
    run.show(result, print_table)
    run.unreadable = 0 if stopped else watching.unreadable
    failed = not stopped and any(record.verdict in ("failed", "check_input") for record in result.curves)
    run.end(f"{digits.counted(len(pairs), 'curve')} in {{seconds}}; report: {out / 'report.html'}", failed)
