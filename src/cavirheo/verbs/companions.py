"""`cavirheo compare`, `rheometer`, `collapse-time`, `design`: other methods beside `infer`, and the next experiment.

The annotations of options are objects, not text, as in settings.py.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cavirheo import settings
from cavirheo.settings import argument, number, option
from cavirheo.verbs.run import REFERENCES, Out, Run, Verb, has_problems, numbers
from cavirheo.writing import digits

_Range = tuple[float, float]
_Material = Literal["nhkv", "nh", "newtonian"]
_WANTED = "wanted half-width of the 90 % interval, % of the value"
_SWEEPS = "sweeps of one material: .csv, .txt, .xlsx; a folder"
_TIMES = "tables of rmax_um,stretch,t1_us (.csv, .xlsx); a folder"


@dataclass(frozen=True, kw_only=True)
class Compare(Verb):
    """Answers that exist beside published values, with ratios; `infer --references` answers and compares."""

    result: Annotated[Path, argument("RESULT", "result.json, or the folder that holds one", readable=False)]
    references: Annotated[list[Path], option(REFERENCES)]
    out: Out = Path("cavirheo-comparison")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.published_values import by_group, read_sets
        from cavirheo.loading import load
        from cavirheo.reporting import DOCUMENTS, write_documents
        from cavirheo.reporting.record import Result
        from cavirheo.reporting.screen import print_comparison

        sets = read_sets(self.references)
        answers = load(self.result, Result)
        path = self.result / "result.json" if self.result.is_dir() else self.result
        outputs = run.outputs(self.out, *DOCUMENTS, inputs=[path, *self.references])
        head = run.document_fields | {"notes": [*run.notes, *answers.notes]}
        head["command"] = f"{answers.command}; {run.command}"  # `cite` quotes what made the answers, too
        document = Result(**vars(answers) | head)
        document.add_published(by_group([group.name for group in document.groups], sets))
        for note in document.notes[len(head["notes"]) :]:
            run.note(note)
        write_documents(outputs, [], document, draw=False)
        run.show(document, print_comparison)
        counts = f"{digits.counted(len(document.groups), 'group')}, {digits.counted(len(document.curves), 'shot')}"
        run.end(counts, has_problems(document), f"; report: {self.out / 'report.html'}")


@dataclass(frozen=True, kw_only=True)
class Rheometer(Verb):
    """Linear range, plateau modulus and viscosity from the oscillatory sweeps of a rheometer."""

    files: Annotated[list[Path], argument("FILE...", _SWEEPS, readable=False)]
    at: Annotated[float | None, number("angular frequency of G''/omega, rad/s  [default: 1]", above=0)] = None
    out: Out = Path("cavirheo-rheometer")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions import rheometer

        files = run.files(self.files)
        outputs = run.outputs(self.out, "rheometer.json", inputs=files)
        at = self.at or 1.0
        sweeps = run.read("sweep", files, lambda path: rheometer.read_sweeps(path, at))
        idle = self.at is not None and all(sweep.kind == "strain" for sweep in sweeps)
        run.notes += [f"no µ at {at:g} rad/s (--at): there is no frequency sweep"] if idle else []
        name = rheometer.shared_name([Path(source) for source in dict.fromkeys(sweep.source for sweep in sweeps)])
        rheometry = rheometer.rheometry(sweeps, name, at=at, **run.document_fields)
        run.write_document(outputs, rheometry)
        run.end(f"written to {self.out}", idle or any(sweep.message for sweep in sweeps))


@dataclass(frozen=True, kw_only=True)
class CollapseTime(Verb, settings.Liquid):
    """G and µ from the times of the first collapse alone: one answer per table."""

    files: Annotated[list[Path], argument("FILE...", _TIMES, readable=False)]
    material: Annotated[_Material, option("nh has no viscosity, newtonian no elasticity")] = "nhkv"
    exact: Annotated[bool, option("fit with simulated collapse times: seconds", None, "--exact")] = False
    shear_modulus: Annotated[float | None, number("Pa, if it is known: only µ is fitted")] = None
    viscosity: Annotated[float | None, number("Pa s, if it is known: only G is fitted")] = None
    stretch: Annotated[float | None, number("R_max/R_0 of tables without it", above=1, most=1000)] = None
    shots: settings.Shots = None
    out: Out = Path("cavirheo-collapse-time")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions import collapse_times
        from cavirheo.io.shots import shot_numbers

        shot_numbers(self.shots)
        files = run.files(self.files)
        liquid = self.liquid
        outputs = run.outputs(self.out, "collapse-time.json", "shots.csv", inputs=files)
        groups = run.read(
            "collapse time", files, lambda path: [collapse_times.read_table(path, self.stretch, self.shots)]
        )
        if self.exact:
            run.say("simulating (the solver is compiled once per machine, 10 to 30 s) ...")
        known = {"shear_modulus": self.shear_modulus, "viscosity": self.viscosity}
        for group in groups:
            group.answer(self.material, liquid, exact=self.exact, **known)
        head = {"material": self.material, "medium": asdict(liquid), **run.document_fields}
        document = collapse_times.CollapseTimes(groups=groups, **head)
        outputs.write("shots.csv", collapse_times.write_csv, document)
        run.write_document(outputs, document)
        failed = any(group.incomplete or (self.exact and group.model != "exact") for group in groups)
        run.end(f"written to {self.out}", failed)


@dataclass(frozen=True, kw_only=True)
class Design(Verb, settings.Liquid, settings.BubbleOptions):
    """Which shot to take next, and how many: expected intervals over R_max and frame rate."""

    result: Annotated[Path | None, argument("[RESULT]", "result.json with what is known so far", readable=False)] = None
    group: Annotated[str | None, option("group of the result.json whose material is meant")] = None
    shear_modulus: Annotated[_Range | None, number("range in Pa, without a RESULT", metavar="LOW HIGH")] = None
    viscosity: Annotated[_Range | None, number("Pa s", metavar="LOW HIGH")] = None
    stretch: Annotated[_Range | None, number("R_max/R_0  [default: of the RESULT, or 4 10]", metavar="LOW HIGH")] = None
    material: Annotated[str, option("a law of `cavirheo laws`")] = "nhkv"
    medium: Annotated[str | None, option(f"{settings.MEDIUM}  [default: that of the RESULT, or water]")] = None
    rmax_um: Annotated[_Range, number("R_max of the rig, um", metavar="LOW HIGH", **settings.SIZES_UM)] = (50, 400)
    fps: Annotated[str, option("frames per second of the camera, with commas")] = "1e5,2.5e5,5e5,1e6"
    frames: Annotated[int, number("of a recording", kind=int, least=10)] = 128
    noise_percent: Annotated[float, number("noise of the radius, % of R_max", above=0, most=49)] = 1.0
    wanted_percent: Annotated[float, number(_WANTED, least=0.1, most=99)] = 10.0
    seed: settings.Seed = 0
    out: Out = Path("cavirheo-design")

    def __call__(self, run: Run) -> None:
        from cavirheo.companions.design import DRAWS, Rig, design
        from cavirheo.loading import load
        from cavirheo.reporting.record import Result

        rig = Rig(
            max_radius=[1e-6 * end for end in self.rmax_um],
            frame_rate=numbers("--fps", self.fps, float, ",", "numbers with commas"),
            frames=self.frames,
            noise=0.01 * self.noise_percent,
            material=self.material,
            medium=self.liquid if self.given else None,
            bubble=self.full_bubble or "real",
        )
        ranges = {name: ends for name in ("shear_modulus", "viscosity", "stretch") if (ends := getattr(self, name))}
        outputs = run.outputs(self.out, "design.json", inputs=[self.result] if self.result else [])
        with run.progress_bar("answering", len(rig.settings()) * DRAWS) as advance:
            how: dict[str, Any] = {"wanted": 0.01 * self.wanted_percent, "seed": self.seed, "done": advance}
            document = design(self.result and load(self.result, Result), rig, group=self.group, ranges=ranges, **how)
        fields = run.document_fields | {"notes": [*run.notes, *document.notes]}
        run.write_document(outputs, document.model_copy(update=fields))
        run.end(f"written to {self.out}")
