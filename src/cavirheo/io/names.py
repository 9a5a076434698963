"""Names of the quantities of a shot as people and programs write them, with their units: titles of columns, variables
of MATLAB, datasets, and single numbers that a file states. The units themselves are in `parameters`."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cavirheo.io.tables import Name, Term, Vocabulary
from cavirheo.parameters import LENGTH_UNITS, TIME_UNITS, unit_of

RADIUS_UNITS = {**LENGTH_UNITS, "px": 1e-6}  # px: a placeholder factor until R_max is given
_UNITS = {unit: np.nan for unit in (*TIME_UNITS, *RADIUS_UNITS)}  # recognises a unit of another quantity, to report it
AREA_UNITS = {f"{unit}2": unit for unit in RADIUS_UNITS} | {"px": "px"}  # the unit of length that belongs to an area
_SHOT = r"(?:shot|bubble|curve|run|exp|experiment|schuss|blase|kurve|tir|bulle|courbe|essai|disparo|burbuja|curva)"
_NUMBER = re.compile(rf"(?:\b|_)?({_SHOT}?)[\s_#.\-]*(\d+)(?!.*\d)", re.I)  # the last number in a title
_EXPECTED = "begin the file with a header line such as time_us,radius_um, or time_us,R1_um,R2_um for several shots"
_EXPECTED += "; if it has no times, give the frame rate (--fps)"


def _shot_name(title: str) -> Name:
    """Return what a title with a shot number names (`R2_um`, `Radius shot 2 (um)`, `Shot 0 (um)`); `R0` has none."""
    match = _NUMBER.search(title[:200])
    if not match or not (match[1] or match[2].strip("0")):
        return Name()
    shot, number = match.groups()
    words = f"{title[: match.start()]} {title[match.end() :]}".strip()
    kind, unit, _ = CURVES.name_by_words(words)
    if kind in ("time", "frame", "radius", "diameter", "area", "radius_std"):
        return Name(kind, unit, number)
    unit = unit_of(words.strip("_[]()/ "), RADIUS_UNITS)
    return Name("radius", unit, number) if shot and (unit or not words) else Name()


OF_MEDIUM = {  # constants that a file may state
    "density": Term("rho density rho0 rhoinf rhol", {"kgm3": 1.0, "kgm-3": 1.0, "gcm3": 1e3}),
    "pressure": Term("pinf pressure pambient patm", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5}),
}
_OF_SHOT = {
    **OF_MEDIUM,
    "radius at rest": Term("req rinf requilibrium equilibriumradius restradius", RADIUS_UNITS),
    "frame rate": Term("fps framerate framespersecond", {"Hz": 1.0, "fps": 1.0, "kHz": 1e3, "MHz": 1e6}),
    "um per pixel": Term("umperpx umperpixel micronsperpixel micronperpixel scaleumpx scaleumpixel", {"umpx": 1.0}),
}
CURVES = Vocabulary(
    {
        **_OF_SHOT,  # an R_eq that changes is a radius, as below
        "time": Term(
            "t time elapsedtime reltime relativetime timestamp positiont xvalue tnondimall zeit temps tiempo "
            "tempo 時間 时间",
            {**_UNITS, "frame": np.nan},
        ),
        "frame": Term(
            "frame frames frameno framenumber framenr frameindex framenum image imageno imagenumber slice bild bildnr "
            "bildnummer fotograma cuadro numeroimage numerodimage フレーム フレーム番号 コマ 帧 帧号 帧数",
            _UNITS,
        ),
        "radius": Term(
            "r radius rt roft rnew rnondimall shiftnormrnew "
            "bubbleradius radiusofbubble radiusofthebubble meanradius averageradius equivalentradius "
            "effectiveradius fittedradius radiusfit rfit reff req rbubble radiusmean rmean radiusr blasenradius "
            "mittlererradius rayon rayonbulle rayondebulle rayondelabulle rayonmoyen rayonequivalent radio "
            "radioburbuja radiodeburbuja radiodelaburbuja raggio raio 半径 半徑 気泡半径 气泡半径 氣泡半徑",
            _UNITS,
        ),
        "max_radius": Term("rmax truermax maxradius maximumradius", _UNITS),
        "stretch": Term("stretch lambdamax lambdamaxmean"),
        "stretch_std": Term("stretchstd lambdamaxstd"),
        "radius_std": Term(
            "radiusstd rstd radiussd rsd err error radiuserr radiuserror rerr rerror errr errradius dr drad deltar "
            "sd std stdev stddev stdradius stdr sdr sigma sigmar radiussigma uncertainty radiusuncertainty "
            "dd derr dstd sem σ σr ± δr ur fehler radiusfehler standardabweichung erreur incertitude ecarttype",
            _UNITS,
        ),
        "diameter": Term(
            "d diam diameter bubblediameter meandiameter equivalentdiameter equivdiameter durchmesser "
            "blasendurchmesser diametre diametrebulle diametredebulle diametredelabulle diametreequivalent diametro "
            "直径 直徑 気泡直径 气泡直径",
            _UNITS,
        ),
        "half_a": Term("a semimajor semimajoraxis majorsemiaxis halfmajoraxis", _UNITS),
        "half_b": Term("b semiminor semiminoraxis minorsemiaxis halfminoraxis", _UNITS),
        "major": Term("major majoraxis majoraxislength majordiameter dmajor", _UNITS),
        "minor": Term("minor minoraxis minoraxislength minordiameter dminor", _UNITS),
        "area": Term("area bubblearea aire flache", {**_UNITS, **dict.fromkeys(AREA_UNITS, np.nan)}),
        "curve": Term("curve shot trackid"),
    },
    _EXPECTED,
    required=("time|frame", "radius|diameter|half_b|minor|area"),
    codes=dict.fromkeys(("empty", "rows"), "table.empty") | {"columns": "table.columns", "twice": "table.twice"},
    fallback=_shot_name,
    of_shots=True,
)
WITHOUT_TIMES = replace(CURVES, required=CURVES.required[1:])
STATED = Vocabulary(
    {
        **_OF_SHOT,
        "frame interval": Term("deltat dt frameinterval", TIME_UNITS),
        "size of a pixel": Term("deltax", RADIUS_UNITS),
        "stretch": Term("stretch lambda lambdamax lambdamaxmean"),
        "stretch_std": Term("stretchstd lambdastd lambdamaxstd"),
    },
    "",
    (),
)
PER_SHOT = ("max_radius", "stretch", "stretch_std", *OF_MEDIUM)  # kinds of columns with one number for a shot
OF_CAMERA: dict[str, tuple[str, str, Callable[[float], float]]] = {  # field of Camera; unit in the file; its value
    "frame interval": ("frame_rate", "s", lambda interval: 1.0 / interval),
    "frame rate": ("frame_rate", "per second", lambda rate: rate),
    "size of a pixel": ("um_per_px", "m", lambda size: 1e6 * size),
    "um per pixel": ("um_per_px", "", lambda scale: scale),
}
