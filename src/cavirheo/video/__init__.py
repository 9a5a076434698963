"""Recordings -> radius histories; and synthetic recordings with a known one."""

from __future__ import annotations

from cavirheo.video.film import Film, Scene, render

__all__ = ["Film", "Scene", "render"]
