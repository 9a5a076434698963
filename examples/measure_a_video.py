"""From a recording to G and mu: measure the radii, look at the flags, infer."""

from collections import Counter
from pathlib import Path

import cavirheo

video = Path(__file__).parent / "bubble.mp4"  # made by make_examples.py; a video file does not know these numbers:
curve = cavirheo.measure(video, frame_rate=500e3, um_per_px=4.0, exposure=0.4e-6)
flags = Counter(curve.meta["flags"])
print(f"R_max {curve.max_radius * 1e6:.1f} um, {flags.pop('ok')} frames ok, others: {dict(flags)}", end="; ")
answer = cavirheo.infer(curve)
print(f"G {answer.median('G'):.0f} Pa (true 10000), mu {answer.median('mu'):.4f} Pa s (true 0.06)")
