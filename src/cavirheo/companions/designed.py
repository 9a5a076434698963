"""What a shot at a setting would tell, as design.json holds it."""

from __future__ import annotations

from cavirheo.writing.document import Finite, Record


class DesignedSetting(Record):
    """What a shot at one setting would tell, over the draws of what is known.

    Attributes:
        max_radius_m: R_max, m.
        frame_rate_hz: frames per second.
        frames: in a recording.
        noise_m: standard deviation of a radius, m.
        readable: share of recordings that can be read.
        half_width_percent: by parameter, half of the 90 % interval of one shot over the median, that of the middle
            draw.
        half_width_ends_percent: by parameter, between which the middle draw is with 68 % for so few draws (bootstrap).
        shots: how many bring all parameters to what is wanted; null: more than 10,000.
        gain_nats: expected information gain of one shot about the law's parameters, mean over the draws.
        gain_error_nats: its standard error.
    """

    max_radius_m: float
    frame_rate_hz: float
    frames: int
    noise_m: float
    readable: float
    half_width_percent: dict[str, Finite]
    half_width_ends_percent: dict[str, tuple[Finite, Finite]] = {}
    shots: int | None
    gain_nats: float
    gain_error_nats: float = 0.0


class CheckedSetting(Record):
    """What `infer` gives at a recommended setting.

    Attributes:
        setting: index in `settings`.
        recordings: how many were simulated.
        answers: how many of them were answered with an interval.
        told_percent: by parameter, half of the 90 % interval over the median as expected, geometric mean.
        reached_percent: the same as answered.
        shots: as in `settings`, with the information that was reached.
    """

    setting: int
    recordings: int
    answers: int
    told_percent: dict[str, Finite]
    reached_percent: dict[str, Finite]
    shots: int | None
