"""Which names of Python the reference shows: by page and group, those of each room; the laws are those that are known.

tests/meta/test_site.py finds a name that a page or an example imports and that is missing here.
"""

from __future__ import annotations

from typing import NamedTuple

from cavirheo.physics.materials import KINDS


class Group(NamedTuple):
    """`names`: those of each room, between spaces; `said`: a sentence above them."""

    title: str
    names: dict[str, str]
    said: str = ""

    @property
    def whole(self) -> list[str]:
        """The names with their rooms."""
        return [f"{room}.{name}" for room, names in self.names.items() for name in names.split()]


class Page(NamedTuple):
    """A page of the reference; `said`: below its title."""

    title: str
    said: str
    groups: tuple[Group, ...]


def laws(kind: str) -> Group:
    """The laws of a kind."""
    rooms: dict[str, str] = {}
    for law in KINDS[kind].values():
        rooms[law.__module__] = f"{rooms.get(law.__module__, '')} {law.__name__}"  # type: ignore[attr-defined]
    written = ", ".join(f"`{name}`" for name in KINDS[kind])
    return Group(f"Laws: {kind}", rooms, f"As text: {written}.")


START = Page(
    "Python",
    "`import cavirheo` gives these names. [What answers hold](answers.md), [laws and media](laws.md) and "
    "[further functions](more.md) have their own pages.",
    (
        Group("Read and measure", {"cavirheo": "read_curves measure RadiusCurve"}),
        Group("Infer and fit", {"cavirheo": "infer infer_many fit fit_many table Posterior Bubble predict_radius"}),
        Group("Many shots, and the next one", {"cavirheo": "population Population CommonErrors design Rig"}),
        Group("Read back", {"cavirheo": "load"}, "[File formats](../docs/file-formats.md)."),
        Group("Simulate", {"cavirheo": "simulate simulate_many Simulation Medium"}),
        Group("Materials", {"cavirheo": "NeoHookeanKelvinVoigt Newtonian QuadraticKelvinVoigt"}),
        Group("Errors", {"cavirheo": "InputError SolverError"}),
    ),
)
ANSWERS = Page(
    "What answers hold",
    "Functions give these objects, or objects that hold them; nobody else makes them.",
    (
        Group(
            "Parts of a Posterior",
            {
                "cavirheo.posterior": "Checks Diagnostics Evidence Bubble Heap",
                "cavirheo.messages": "Message",
            },
        ),
        Group(
            "Of a Simulation",
            {
                "cavirheo.physics.simulate": "Contents",
            },
        ),
        Group(
            "Documents",
            {
                "cavirheo.reporting.record": (
                    "Result CurveRecord Sentence Compared GroupRecord PublishedValue PopulationRecord Systematic "
                    "MaterialRatio LawsOfGroup LawOfGroup"
                ),
                "cavirheo.companions.design": "Design DesignedSetting",
                "cavirheo.companions.collapse_times": "CollapseTimes CollapseGroup CollapseShot",
                "cavirheo.companions.rheometer": "Rheometry",
                "cavirheo.reporting.measured": "Measured",
                "cavirheo.video.measurement": "StatedNumber",
                "cavirheo.writing.document": "Document Quantity Spread",
            },
            "`cavirheo.load` gives them; [File formats](../docs/file-formats.md) says which file is which.",
        ),
        Group(
            "Training sets",
            {
                "cavirheo.training.dataset": "Dataset",
                "cavirheo.inference.network_files": "TrainingProblem",
                "cavirheo.prior": "Prior",
            },
        ),
    ),
)
LAWS = Page(
    "Laws, media and driving",
    "What surrounds the bubble, for `simulate`, `fit` and [a law of your own](../docs/how-to/add-a-law.md).",
    (
        Group("By text", {"cavirheo.physics.materials": "parse LAWS"}, "As on the command line."),
        *map(laws, KINDS),
        Group("Sums of laws", {"cavirheo.physics.materials": "Viscoelastic"}),
        Group(
            "Your own",
            {"cavirheo.physics.laws": "Elastic Viscous Arm Material"},
        ),
        Group("Media", {"cavirheo.physics.media": "medium MEDIA WATER BU2026 ESTRADA2018 ZHU2025 YANG2020"}),
        Group("Driving", {"cavirheo.physics.media": "Pulse Trace Driving"}),
        Group("Damage", {"cavirheo.physics.bubble": "Damage"}),
        Group("Accuracy", {"cavirheo.physics.accuracy": "Accuracy DEFAULT PRECISE ROUGH"}),
        Group("Parameters", {"cavirheo.parameters": "Parameter PARAMETERS"}),
    ),
)
MORE = Page(
    "Further functions",
    "Each is imported from the module that its name begins with.",
    (
        Group(
            "Which law",
            {"cavirheo.inference.which_law": "rank_laws Ranking", "cavirheo.posterior": "Pair"},
            "[How](../docs/how-to/which-law.md).",
        ),
        Group(
            "Collapse times",
            {
                "cavirheo.inference.collapse_time": "estimate CollapseEstimate",
                "cavirheo.physics.collapse": "analytic_time rayleigh_time simulated_time",
            },
            "[How](../docs/how-to/collapse-time.md).",
        ),
        Group(
            "Rheometer",
            {
                "cavirheo.companions.rheometer": "Sweep read_sweeps strain_sweep frequency_sweep",
            },
            "[How](../docs/how-to/rheometer.md).",
        ),
        Group("Write", {"cavirheo.reporting": "result write_report", "cavirheo.io": "write_csv"}),
    ),
)
PAGES = {"python": START, "answers": ANSWERS, "laws": LAWS, "more": MORE}
