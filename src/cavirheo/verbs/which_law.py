"""`cavirheo which-law`: the evidence of several laws for the same curves, as a table and laws.json."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from cavirheo.verbs import options
from cavirheo.verbs.run import Reading, Run

if TYPE_CHECKING:
    from cavirheo.curve import RadiusCurve
    from cavirheo.inference.verify.evidence import Ranking
    from cavirheo.posterior import Posterior
    from cavirheo.reporting.laws import WeighedLaws
    from cavirheo.unfinished import Step


def which_law(
    files: options.Curves,
    laws: options.ManyLaws = "nhkv,newtonian,power-law,carreau-yasuda,qkv,fung + newtonian,zener",
    contents: options.ManyContents = "equilibrium",
    damage: Annotated[str, Option(help="models of softening: none, first-rebound, strain, with commas")] = "none",
    wall_inertia: Annotated[str, Option(help="for all models: R_max sum(s/d) over image bubbles; or free")] = "0",
    window: Annotated[
        str | None, Option(help="number of collapses to compare, or 'all'  [default: 3, or all if there are fewer]")
    ] = None,
    stretch: Annotated[str | None, Option(help="R_max/R_0, or 'plateau': late radius as prior; inferred otherwise")] = (
        None
    ),
    exact_law: options.ExactLaw = False,
    column: options.Column = None,
    seed: options.Seed = 0,
    reading: Reading = options.FROM_OPTIONS,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-laws"),
    figures: options.Figures = None,
    scheduler: options.Scheduler = None,
    run: Run = options.FROM_OPTIONS,
) -> None:
    """Which of several laws explains the curves best? Evidence by importance sampling, 1 to 30 s a curve and law."""
    from cavirheo.cluster import connected
    from cavirheo.inference import infer_many
    from cavirheo.inference.fit import fit_many
    from cavirheo.inference.options import Options
    from cavirheo.inference.verify import verify_many
    from cavirheo.inference.verify.evidence import by_network, contending, models, ranked
    from cavirheo.inference.verify.tuning import TUNING
    from cavirheo.posterior import BubbleModel
    from cavirheo.reporting.laws import Laws, print_table
    from cavirheo.reporting.paper import laws_figure, names, write
    from cavirheo.unfinished import Step, Unfinished
    from cavirheo.writing import document

    files = run.files(files)
    paper = options.for_paper(figures)
    given = ([name.strip() for name in text.split(",") if name.strip()] for text in (laws, contents, damage))
    looked_at, known = options.window_of(window), options.stretch_of(stretch)
    chosen = models(*given)
    walls = options.wall_inertia_of(wall_inertia)
    Options(window=looked_at, stretch=known, bubble=BubbleModel(wall_inertia=walls))
    outputs = document.Outputs(out, "laws.json", inputs=files)
    with connected(scheduler, run.say) as executor:
        kept = Unfinished(out, shown=not run.quiet, executor=executor)
        curves = run.read(files, liquid, reading, column)
        shared: dict[str, Any] = {"medium": liquid, "stretch": known, "seed": seed}
        weighing: dict[str, Any] = {"discrepancy": not exact_law, "draws": TUNING.law_draws, **shared}
        climbing = {**weighing, "level": "map", "scanned": TUNING.law_scanned}
        found: dict[str, dict[int, Posterior]] = {}
        steps: dict[str, tuple[Step, ...]] = {}
        for law, way in chosen.items():
            if by_network(way, wall_inertia=walls, stretch=known):
                inferring = {"material": way["material"], "contents": way["contents"]}
                inferring |= {"trust_input": reading.trust_input, "window": looked_at, **weighing}
                steps[law] = (Step(f"weighing {law}", infer_many, inferring),)
                found[law] = dict(kept.answers(curves, *steps[law]))
                continue
            fitting = {**way, "window": looked_at, "wall_inertia": walls, "trust_input": reading.trust_input, **shared}
            fitting |= {"windows": False, "others": False, "draws": False}
            fit, climb = Step(f"fitting {law}", fit_many, fitting), Step(f"climbing {law}", verify_many, climbing)
            steps[law] = fit, climb, Step(f"weighing {law}", verify_many, weighing)
            found[law] = dict(kept.answers(curves, *steps[law][:2]))
        whole = all(len(answers) == len(curves) for answers in found.values())
        climbed = {law: list(answers.values()) for law, answers in found.items()} if whole else {}
        for law, near in contending(climbed).items():
            if len(steps[law]) == 1:
                continue
            full = kept.answers([curves[i] for i in near], *steps[law])
            rest = {i: answer for i, answer in found[law].items() if i not in near}
            found[law] = rest | {near[k]: answer for k, answer in full.items()}
        found = found if whole else {law: {} for law in found}
    complete = [i for i in range(len(curves)) if all(i in answers for answers in found.values())]
    answered, note = [curves[i] for i in complete], kept.note(len(complete), len(curves))
    singles, groups = ranked(answered, {law: [answers[i] for i in complete] for law, answers in found.items()})
    weighed = [_weighed(one, curve) for one, curve in zip(singles, answered, strict=True)]
    notes = [*([note] if note else []), *run.notes]
    made = Laws(command=run.command, notes=notes, curves=weighed, groups=[_weighed(one) for one in groups])
    if answered:
        outputs.write("laws.json", document.write_json, made)
    if note:
        run.stop(note, out / "laws.json" if answered else None)
    if paper:
        stems = names([one.name for one in made.curves], [one.name for one in made.groups])
        for stem, one in zip(stems, [*made.curves, *made.groups], strict=True):
            write(outputs, stem, laws_figure(one))
    outputs.finish()
    kept.remove()
    run.show(made, print_table)
    verdicts = {answer.checks.verdict for one in singles for answer in one.answers.values()}
    failed = "check_input" in verdicts or any(one.chosen is None for one in singles)
    run.end(f"{len(curves)} curves in {{seconds}}; {out / 'laws.json'}", failed)


def _weighed(one: Ranking, curve: RadiusCurve | None = None) -> WeighedLaws:
    from cavirheo.reporting.answer import curve_record
    from cavirheo.reporting.laws import ComparedLaws, WeighedLaw, WeighedLaws
    from cavirheo.reporting.material import population_record

    probability = one.probability
    laws = {
        law: WeighedLaw(
            log_evidence=value,
            standard_error=one.error[law],
            probability=probability.get(law),
            answer=curve_record(curve, one.answers[law]) if curve else None,
            population=population_record(one.populations.get(law), one.column),
        )
        for law, value in one.log_evidence.items()
    }
    pairs = [ComparedLaws(**vars(pair)) for pair in one.pairs]
    return WeighedLaws(
        name=one.name, shots=one.shots, chosen=one.chosen, contenders=one.contenders, laws=laws, pairs=pairs
    )
