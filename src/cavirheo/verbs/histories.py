"""`cavirheo measure` and `simulate`: the radius history of a recording, or of parameters and a law.

The annotations of options are objects, not text, as in settings.py.
"""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cavirheo import settings
from cavirheo.errors import InputError, require
from cavirheo.settings import BUBBLE, MATERIAL, OUTPUT, argument, number, option
from cavirheo.verbs.run import Out, Run, Verb, numbers

if TYPE_CHECKING:
    from cavirheo.physics.bubble import Bubble

_VIDEO = ".mp4, .avi, .mkv, .mov, .tif, .cine, .mraw (+ .cihx or .cih); a folder of images"
DRIVING = "Driving"
_FRAMES_FILE = "simulation.csv"
_MATERIAL = "laws with SI parameters (see `cavirheo laws`): 'nhkv(2e3, 0.05)', 'yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)'"
_Motion = Literal["keller-miksis", "rayleigh-plesset", "gilmore"]
_POLYTROPIC = "exponent of the gas, instead of heat and vapour transport"
_PULSE = "ultrasound: peak kPa (negative: tension), MHz, us of the peak"
_FACTORS = "damaged gel: factors of modulus and R_0 at a tenfold contraction"
_DAMAGE = number(_FACTORS, BUBBLE, metavar="MODULUS RADIUS")


@dataclass(frozen=True, kw_only=True)
class Measure(Verb):
    """Radii of a bubble, with standard deviations, from a high-speed recording."""

    video: Annotated[Path, argument("VIDEO", _VIDEO, readable=False)]
    fps: settings.Fps = None
    um_per_px: settings.UmPerPx = None
    exposure_us: settings.ExposureUs = None
    polarity: Annotated[Literal["auto", "dark", "bright"], option("the bubble's look before its background")] = "auto"
    roi: Annotated[str | None, option("part of the picture to measure, px", metavar="X,Y,W,H")] = None
    frames: Annotated[str | None, option("first and last frame to measure", metavar="A:B")] = None
    exclude: settings.Exclude = None
    out: Out = Path("cavirheo-measure")

    def __call__(self, run: Run) -> None:
        from cavirheo.io.shots import examine
        from cavirheo.reporting.measured import describe, write_csv
        from cavirheo.video.formats import EXTRA
        from cavirheo.video.measurement import contact_sheet
        from cavirheo.writing.document import try_to_draw
        from cavirheo.writing.export import import_optional

        import_optional("PIL", EXTRA)
        names = ("um_per_px", "polarity", "exclude")
        camera: dict[str, Any] = {name: getattr(self, name) for name in names} | {"frame_rate": self.fps}
        camera["exposure"] = self.exposure_us and self.exposure_us * 1e-6
        camera["roi"] = numbers("--roi", self.roi, int, ",", "x,y,width,height in px", 4)
        camera["span"] = numbers("--frames", self.frames, int, ":", "first:last", 2)
        path, *others = run.files([self.video])
        if others:
            held = f"{self.video} holds {1 + len(others)}"
            raise InputError(f"measure takes one recording, and {held}: name one, such as {path}", "measure.one")
        outputs = run.outputs(self.out, "measure.json", "measured.csv", "contact.png", inputs=[path])
        camera["progress"] = partial(run.progress_bar, "measuring", unit="frames")
        measurement, curve = examine(path, **camera)
        run.notes += measurement.notes
        record = describe(measurement, curve, **run.document_fields)
        outputs.write("measured.csv", write_csv, measurement)
        try_to_draw("contact.png", record.notes, lambda: outputs.write("contact.png", contact_sheet(measurement).save))
        run.write_document(outputs, record)
        run.end(f"written to {self.out}", bool(record.warnings or record.unusable))


@dataclass(frozen=True, kw_only=True)
class Simulate(Verb, settings.Liquid, settings.BubbleOptions):
    """One bubble from rest at its largest radius, or at equilibrium (--stretch 1) under ultrasound.

    Columns of simulation.csv: time_us, radius_um, velocity_m_per_s of the wall, pressure_Pa in the bubble, stress_Pa of
    the material (stress integral), hoop strain and strain_rate_per_s at the wall.
    """

    rmax_um: Annotated[float, number("largest radius, um", **settings.SIZES_UM)]
    stretch: Annotated[float, number("R_max/R_0")]
    material: Annotated[str, option(_MATERIAL)]
    duration_us: Annotated[float, number("us after R_max", above=0, most=1e6)] = 100.0
    fps: Annotated[float, number("frames per second")] = 1e6
    pulse: Annotated[tuple[float, float, float] | None, number(_PULSE, DRIVING, metavar="KPA MHZ US")] = None
    motion: Annotated[_Motion, option("equation of the wall", BUBBLE)] = "keller-miksis"
    polytropic: Annotated[float | None, number(_POLYTROPIC, BUBBLE)] = None
    damage: Annotated[tuple[float, float] | None, _DAMAGE] = None  # type: ignore[assignment]
    relaxed: Annotated[bool, option("laws with memory start unstressed", MATERIAL, "--relaxed")] = False
    precise: Annotated[bool, option("six times as accurate, five times as long", OUTPUT, "--precise")] = False
    out: Out = Path("cavirheo-simulation")

    def __call__(self, run: Run) -> None:
        import numpy as np

        from cavirheo.physics import simulate as forward
        from cavirheo.physics.accuracy import DEFAULT, PRECISE
        from cavirheo.physics.materials import parse
        from cavirheo.physics.media import Pulse

        liquid = self.liquid
        law = parse(self.material)
        count = self.duration_us * 1e-6 * self.fps
        if not (self.fps > 0 and 1 <= count <= 1e6):
            got = f"got {self.duration_us} us at {self.fps} frames per second"
            raise InputError(f"duration and frame rate must give 1 to a million frames, {got}", "simulate.frames")
        frames = int(count * (1 + 1e-9)) + 1
        bubble = self.make_bubble()
        far_field = None
        if self.pulse:
            kilopascals, megahertz, microseconds = self.pulse
            require(megahertz > 0, f"the MHz of --pulse must be above 0, got {megahertz:g}", "physics.frequency")
            far_field = Pulse(kilopascals * 1e3, megahertz * 1e6, microseconds * 1e-6)
        outputs = run.outputs(self.out, _FRAMES_FILE)
        forward.load_solver()
        simulation = forward.simulate(
            law,
            max_radius=self.rmax_um * 1e-6,
            stretch=self.stretch,
            time=np.arange(frames) / self.fps,
            medium=liquid,
            driving=far_field,
            bubble=bubble,
            relaxed=self.relaxed,
            accuracy=PRECISE if self.precise else DEFAULT,
        )
        rows, head = np.column_stack([*simulation.columns.values()]), ",".join(simulation.columns)
        as_csv: dict[str, Any] = {"fmt": "%.9g", "delimiter": ",", "header": head, "comments": ""}
        outputs.write(_FRAMES_FILE, partial(np.savetxt, X=rows, **as_csv))
        outputs.finish()
        run.say(f"{frames} frames of {self.material} in {liquid.name}: {self.out / _FRAMES_FILE}")

    def make_bubble(self) -> "Bubble":
        """Return the bubble of the options, by default the field's. Raises InputError."""
        from cavirheo.physics.bubble import ACCOMMODATION, Damage, bubble_of

        base = bubble_of(self.bubble or "field")
        kinetic = (self.contents or base.contents) == "kinetic"
        values = ({"accommodation": ACCOMMODATION} if kinetic else {}) | self.bubble_values
        damage = Damage(*self.damage) if self.damage else "none"
        return replace(base, **{**values, "exponent": self.polytropic, "damage": damage})
