"""`cavirheo simulate`: parameters in, one simulated radius history out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from cavirheo.errors import InputError, SolverError, require
from cavirheo.verbs import options
from cavirheo.writing.terminal import say

if TYPE_CHECKING:
    from cavirheo.physics.bubble import Bubble
    from cavirheo.physics.law import Material
    from cavirheo.physics.simulation import Simulation

_FRAMES, _FIELDS = "simulation.csv", "fields.h5"


def simulate(
    rmax_um: Annotated[float, Option(help="largest radius, um")],
    stretch: Annotated[float, Option(help="R_max/R_0")],
    material: Annotated[
        str,
        Option(
            help="nhkv, newtonian or qkv; or any laws with their parameters (see `cavirheo laws`), "
            "'yeoh(1e3, 20) + cross(0.5, 0.01, 1e-4)'",
            autocompletion=options.any_law_names,
        ),
    ] = "nhkv",
    shear_modulus: Annotated[float | None, Option(help="Pa")] = None,
    viscosity: Annotated[float | None, Option(help="Pa s")] = None,
    stiffening: Annotated[float | None, Option(help="alpha of qkv")] = None,
    duration_us: Annotated[float, Option(help="us after R_max")] = 100.0,
    fps: Annotated[float, Option(help="frames per second")] = 1e6,
    pulse: Annotated[
        tuple[float, float, float] | None,
        Option(help="ultrasound: peak kPa (negative: tension), MHz, us of the peak", metavar="KPA MHZ US"),
    ] = None,
    driving: Annotated[
        Path | None, Option(help="far-field pressure above ambient: CSV file with columns time_us,pressure_kPa")
    ] = None,
    motion: Annotated[str, Option(help="keller-miksis, rayleigh-plesset or gilmore")] = "keller-miksis",
    polytropic: Annotated[float | None, Option(help="exponent of the gas, instead of heat and vapour transport")] = (
        None
    ),
    contents: options.Contents = "equilibrium",
    accommodation: Annotated[float | None, Option(help="of kinetic contents, up to 10  [default: 0.07]")] = None,
    damage: Annotated[
        tuple[float, float] | None,
        Option(help="factors of the modulus and of R_0", metavar="MODULUS RADIUS"),
    ] = None,
    damage_by: Annotated[str, Option(help="first-rebound, or strain (factors at a tenfold contraction)")] = (
        "first-rebound"
    ),
    confinement_inertia: Annotated[
        float, Option(help="R_max sum(s/d) over image bubbles: R_max/2h for one wall at h")
    ] = 0.0,
    wall_distance_um: options.WallDistanceUm = None,
    confinement_damping: Annotated[
        float, Option(help="2 pi (R_max^2/A) c/U_c of a tube of cross-section A around")
    ] = 0.0,
    vapour_excess: Annotated[float, Option(help="vapour at R_max above saturation, Pa")] = 0.0,
    relaxed: Annotated[bool, Option("--relaxed", help="laws with memory start unstressed")] = False,
    precise: Annotated[bool, Option("--precise", help="ten times as accurate, five times as long")] = False,
    fields: Annotated[
        bool, Option("--fields", help="fields.h5, too: temperature and vapour in the bubble at every frame")
    ] = False,
    liquid: options.Liquid = options.FROM_OPTIONS,
    out: options.Out = Path("cavirheo-simulation"),
    quiet: options.Quiet = False,
) -> None:
    """One bubble from rest at its largest radius, or at equilibrium (--stretch 1) under ultrasound.

    Columns of simulation.csv: time_us, radius_um, velocity_m_per_s of the wall, pressure_Pa in the bubble, stress_Pa of
    the material (stress integral), hoop strain and strain_rate_per_s at the wall.
    """
    import numpy as np

    from cavirheo.physics import simulate as forward
    from cavirheo.physics.accuracy import DEFAULT, PRECISE
    from cavirheo.physics.driving import Pulse, Trace
    from cavirheo.reading.trace import read_trace
    from cavirheo.writing.document import Outputs

    both = "give either --pulse or --driving, not both; a file can hold any sum of pressures"
    require(not (pulse and driving), both, "simulate.two_drivings")
    law = _material(material, shear_modulus=shear_modulus, viscosity=viscosity, stiffening=stiffening)
    possible = duration_us > 0 and fps > 0 and 1 <= duration_us * 1e-6 * fps <= 1e6
    got = f"got {duration_us} us at {fps} frames per second"
    require(possible, f"duration and frame rate must give 1 to a million frames, {got}", "simulate.frames")
    frames = int(duration_us * 1e-6 * fps * (1 + 1e-9)) + 1
    bubble = _bubble(
        contents=contents,
        accommodation=accommodation,
        damage=damage,
        damage_by=damage_by,
        confinement_inertia=confinement_inertia,
        wall_distance_um=wall_distance_um,
        vapour_excess=vapour_excess,
        confinement_damping=confinement_damping,
        motion=motion,
        polytropic=polytropic,
    )
    message = "--polytropic leaves no fields in the bubble: leave out that, or --fields"
    require(not fields or polytropic is None, message, "physics.no_fields")
    far_field = None
    if driving:
        *columns, notes = read_trace(driving)
        try:
            far_field = Trace(*columns)
        except InputError as error:
            raise error.within(str(driving)) from None
        for note in notes:
            say(f"{driving}: {note}")
    writers = {_FRAMES: _write_frames} | ({_FIELDS: _write_fields} if fields else {})
    outputs = Outputs(out, *writers, inputs=[driving] if driving else [])
    forward.load_solver()
    with _named(driving):
        run = forward.simulate(
            law, max_radius=rmax_um * 1e-6, stretch=stretch, time=np.arange(frames) / fps, medium=liquid,
            driving=Pulse(pulse[0] * 1e3, pulse[1] * 1e6, pulse[2] * 1e-6) if pulse else far_field,
            bubble=bubble, relaxed=relaxed, fields=fields, accuracy=PRECISE if precise else DEFAULT,
        )  # fmt: skip
    for name, writer in writers.items():
        outputs.write(name, writer, run)
    outputs.finish()
    if not quiet:
        say(f"{frames} frames of {law} in {liquid.name}: {out / _FRAMES}")


@contextmanager
def _named(driving: Path | None) -> Iterator[None]:
    """A simulation that fails is that of the file that drives it, if one does."""
    try:
        yield
    except SolverError as error:
        raise SolverError(f"{driving}: {error}" if driving else str(error)) from None


def _bubble(
    *,
    accommodation: float | None,
    damage: tuple[float, float] | None,
    damage_by: str,
    wall_distance_um: float | None,
    polytropic: float | None,
    **values: Any,
) -> Bubble:
    """That of the options. Raises InputError, in their words."""
    from cavirheo.physics.bubble import ACCOMMODATION, Bubble, Damage

    idle = accommodation is not None and values["contents"] != "kinetic"
    require(not idle, "--accommodation changes nothing without --contents kinetic: give that too", "simulate.idle")
    alone = "--damage-by changes nothing without --damage: give that too"
    require(damage is not None or damage_by == "first-rebound", alone, "simulate.idle")
    try:
        return Bubble(
            accommodation=ACCOMMODATION if accommodation is None else accommodation,
            damage=Damage(*damage, damage_by) if damage else "none",
            wall_distance=None if wall_distance_um is None else wall_distance_um * 1e-6,
            exponent=polytropic,
            **values,
        )
    except InputError as error:
        raise InputError(re.sub(r"\bexponent\b", "--polytropic", str(error)), error.code) from None


def _material(text: str, **parameters: float | None) -> Material:
    """A name whose parameters are options of the command, or a sum of laws that holds its own."""
    from inspect import signature

    from cavirheo.physics.laws import LAWS, parse
    from cavirheo.physics.materials import MATERIALS

    given = {key: value for key, value in parameters.items() if value is not None}
    if text in MATERIALS:
        needed = list(signature(LAWS[text]).parameters)
        takes = f"material {text!r} takes {', '.join(needed)}; got {', '.join(given) or 'nothing'}"
        require(sorted(given) == sorted(needed), takes, "simulate.parameters")
        return LAWS[text](**given)
    words = ", ".join(f"--{key.replace('_', '-')}" for key in given)
    law = parse(text)
    why = f"--material {text!r} holds its own parameters: leave out {words}"
    require(not given, why, "simulate.parameters_twice")
    return law


def _write_frames(path: Path, run: Simulation) -> None:
    """CSV, a row per frame."""
    import numpy as np

    columns = run.columns
    rows = np.stack(list(columns.values()), axis=1)
    with path.open("wb") as file:
        np.savetxt(file, rows, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")


def _write_fields(path: Path, run: Simulation) -> None:
    """HDF5: time_s (n,), radius_m (n,), position (m,), temperature_K and vapour_mass_fraction (n, m)."""
    import h5py  # a quarter of a second that other uses need not wait for

    assert run.contents is not None
    with h5py.File(path, "w") as file:
        file["time_s"], file["radius_m"] = run.time, run.radius
        file["position"] = run.contents.position
        file["temperature_K"], file["vapour_mass_fraction"] = run.contents.temperature, run.contents.vapour
