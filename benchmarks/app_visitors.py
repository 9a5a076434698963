"""What many visitors at once cost the browser app: errors and times of what they do, how long a short call of a program
waits beside a full run, and the memory of the server afterwards.

    python benchmarks/app_visitors.py [--visitors 20] [--after 150] [--idle 600] [--absent 600]

Visitors are scripts that send what the page sends, so that twenty browsers do not slow what is measured. Each uploads
the same file at the same time, infers its five shots, moves a slider and asks for the zip. Then `--after` more come one
after the other, load the file, ask for answers by one law and leave. Prints Markdown, with the load.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any
from uuid import uuid4

import httpx

from cavirheo.app import steps
from cavirheo.app.session import PageSettings

FILE = steps.examples()["soft_gel.csv"]
OTHER = steps.examples()["stiff_gel.mat"]  # of the crowd: the server keeps the last answers
PORT = 7989


class Visitor:
    """One page: its components by id, and what its events are called with."""

    def __init__(self, address: str) -> None:
        self.web = httpx.Client(base_url=f"{address}/gradio_api/", timeout=600.0)
        self.name, self.said = uuid4().hex[:11], httpx.get(f"{address}/config", timeout=600.0).json()
        self.ids = {one["props"].get("elem_id"): one["id"] for one in self.said["components"]}
        self.values = {one["id"]: one["props"].get("value") for one in self.said["components"]}
        self.here = self.web.stream("GET", f"heartbeat/{self.name}")  # its end tells that the page was closed
        self.here.__enter__()

    def leave(self) -> None:
        self.here.__exit__(None, None, None)
        self.web.close()

    def event(self, source: str, *outputs: str, most: bool = False) -> dict[str, Any]:
        """That which `source` is the first input or the target of, and which changes these; of several the one with the
        fewest inputs, or the most."""
        wanted, source_id = {self.ids[name] for name in outputs}, self.ids[source]
        found = [
            one
            for one in self.said["dependencies"]
            if one["inputs"][:1] == [source_id] or any(of == source_id for of, _ in one["targets"])
            if wanted <= set(one["outputs"])
        ]
        return sorted(found, key=lambda one: len(one["inputs"]))[-1 if most else 0]

    def call(self, source: str, outputs: tuple[str, ...], most: bool = False, **given: Any) -> list[Any]:
        """What the event gives; raises RuntimeError where it fails."""
        event = self.event(source, *outputs, most=most)
        values = self.values | {self.ids[name.replace("_", "-")]: value for name, value in given.items()}
        asked = {"data": [values[k] for k in event["inputs"]], "fn_index": event["id"], "session_hash": self.name}
        asked |= {"event_data": None, "trigger_id": None}
        if event["queue"] is False:
            answer = self.web.post("run/predict", json=asked)
            answer.raise_for_status()
            return list(answer.json()["data"])
        self.web.post("queue/join", json=asked).raise_for_status()
        with self.web.stream("GET", "queue/data", params={"session_hash": self.name}) as stream:
            for line in stream.iter_lines():
                told = json.loads(line.removeprefix("data:")) if line.startswith("data:") else {}
                if told.get("msg") == "process_completed":
                    if not told["success"]:
                        raise RuntimeError(told["output"].get("error"))
                    return list(told["output"]["data"])
        raise RuntimeError("the stream ended")

    def load(self, file: Path = FILE) -> list[str]:
        """The shots of the file, which is uploaded."""
        (kept,) = self.web.post("upload", files={"files": (file.name, file.read_bytes())}).json()
        sent = [{"path": kept, "orig_name": file.name, "meta": {"_type": "gradio.FileData"}}]
        answer = self.call("upload", ("shots-table", "chosen-shots"), upload=sent)
        event = self.event("upload", "shots-table", "chosen-shots")
        boxes = answer[event["outputs"].index(self.ids["chosen-shots"])]
        return [name for name, _ in boxes["choices"]]

    def infer(self, shots: list[str], material: str = "auto") -> None:
        self.call("chosen-shots", ("answers", "steps"), most=True, chosen_shots=shots, material=material)
        self.call("chosen-shots", ("answers", "checked-shot"), chosen_shots=shots)


def resident(server: subprocess.Popen[bytes]) -> str:
    """MB of the server, and of the processes that read for it."""
    children = Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split()
    own, *others = (_resident(int(pid)) for pid in (server.pid, *children))
    return f"{own:.0f} MB, its readers {sum(others):.0f} MB"


def _resident(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def timed(work: Callable[[], Any]) -> tuple[float, Any]:
    began = time.perf_counter()
    try:
        work()
        return time.perf_counter() - began, ""
    except Exception as error:
        return time.perf_counter() - began, f"{type(error).__name__}: {error}"


def at_once(visitors: list[Visitor], work: Callable[[Visitor], Any]) -> str:
    """'median s, largest s, errors' of all of them."""
    with ThreadPoolExecutor(len(visitors)) as pool:
        found = list(pool.map(lambda one: timed(lambda: work(one)), visitors))
    wrong = [why for _, why in found if why]
    times = [seconds for seconds, _ in found]
    first = f" ({wrong[0]})" if wrong else ""
    return f"{median(times):.2f} s, largest {max(times):.2f} s; {len(wrong)} errors{first}"


def main(visitors: int, after: int, idle: float, absent: float) -> None:
    limits = f"VisitorLimits(absent_seconds={absent})"
    imports = "from cavirheo.app.server import serve; from cavirheo.app.session import VisitorLimits"
    served = f"{imports}; serve('127.0.0.1', {PORT}, browser=False, limits={limits})"
    command = [sys.executable, "-c", served]
    server = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    address, rows = f"http://127.0.0.1:{PORT}", list[tuple[str, str]]()
    try:
        while True:
            try:
                first = Visitor(address)
                break
            except (OSError, httpx.HTTPError):
                time.sleep(0.2)
        shots = first.load()
        first.infer(shots)
        rows.append(("memory, one visitor", resident(server)))
        if visitors:
            crowd, one = [Visitor(address) for _ in range(visitors)], Visitor(address)
            theirs = one.load(OTHER)
            one.leave()
            rows.append((f"{visitors} at once: load the same file", at_once(crowd, lambda one: one.load(OTHER))))
            rows.append((f"{visitors} at once: infer 5 shots", at_once(crowd, lambda one: one.infer(theirs))))
            zipped = at_once(crowd, lambda one: one.call("make-zip", ("download",)))
            rows.append((f"{visitors} at once: zip of 5 shots", zipped))
            with ThreadPoolExecutor(1) as pool:
                run = pool.submit(crowd[0].infer, theirs)
                time.sleep(1.0)
                short = timed(lambda: _endpoint(crowd[1]))
                rows.append(("short call of a program beside a run", f"{short[0]:.2f} s {short[1]}"))
                run.result()
            for one in crowd:
                one.leave()
        for _ in range(after):
            one = Visitor(address)
            one.infer(one.load(), "nhkv")
            one.leave()
        rows.append((f"memory after {after + visitors + 1} visitors", resident(server)))
        if idle:
            time.sleep(idle)
            rows.append((f"memory, {idle:g} s later", resident(server)))
    finally:
        server.terminate()
        server.wait()
        print(f"| what ({os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}) | |\n|---|---|")
        print("\n".join(f"| {what} | {figure} |" for what, figure in rows))


def _endpoint(one: Visitor) -> None:
    (kept,) = one.web.post("upload", files={"files": (FILE.name, FILE.read_bytes())}).json()
    given = [[{"path": kept, "meta": {"_type": "gradio.FileData"}}]]
    settings = PageSettings()
    given += [settings.model, "water", None, None, None, None, settings.material]
    event = one.web.post("call/infer", json={"data": given}).json()["event_id"]
    with one.web.stream("GET", f"call/infer/{event}") as stream:
        for line in stream.iter_lines():
            if line.startswith("event: error"):
                raise RuntimeError("the endpoint")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--visitors", type=int, default=20)
    parser.add_argument("--after", type=int, default=130)
    parser.add_argument("--idle", type=float, default=600.0)
    parser.add_argument("--absent", type=float, default=600.0, help="s after which one who left is forgotten")
    main(**vars(parser.parse_args()))
