"""How long the browser app takes: from the command to its page, from a click to the network's own intervals and to the
verified answers of five and of twenty shots, and from the move of a slider to the redrawn simulation; beside the same
functions called without a browser.

    python benchmarks/app.py [--repeats 5]

Needs Chromium and the extras [app] and [dev]. Prints medians (and, as other work on the machine slows wall time, the
load) as Markdown; the results stand in docs/validation.md.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from playwright.sync_api import CDPSession, Page, sync_playwright
from scipy.io import loadmat, savemat

from cavirheo import infer_many, read_curves
from cavirheo.app import steps
from cavirheo.app.server import running_server
from cavirheo.app.session import PageSettings

SHOTS = 20
# From the event to the drawn lines, and the part of it from the request to its answer, ms.
MOVE = """async share => {
  const slider = document.querySelector('#slider-viscosity input[type=range]');
  const line = () => document.querySelector('#check-plot path.what-if')?.getAttribute('d') || '';
  const before = line();
  performance.clearResourceTimings();
  const start = performance.now();
  slider.value = share * slider.max;
  slider.dispatchEvent(new Event('input', {bubbles: true}));
  while (line() === before) await new Promise(requestAnimationFrame);
  const end = performance.now();
  const call = performance.getEntriesByType('resource').find(one => one.name.includes('/run/'));
  return [end - start, call ? call.duration : NaN];
}"""


def many(folder: Path, turn: int, shots: int) -> Path:
    """A .mat of so many shots: the five of the shipped example over and over; radii 0.01 % larger from one to the next,
    for a recording counts once, and the server keeps its last answers."""
    content = {key: value for key, value in loadmat(steps.examples()["stiff_gel.mat"]).items() if key[:2] != "__"}
    tiled = {key: np.tile(value, shots // 5) for key, value in content.items() if value.size == 5}
    tiled["RmaxList"] = tiled["RmaxList"] * (1.0 + 1e-4 * (SHOTS * turn + np.arange(shots)) + 1e-5 * shots)
    savemat(folder / f"shots{shots}_{turn}.mat", content | tiled)
    return folder / f"shots{shots}_{turn}.mat"


def start_up() -> float:
    """s from the command to the page's answer."""
    began = time.perf_counter()
    command = [sys.executable, "-m", "cavirheo", "app", "--no-browser", "--port", "7990"]
    server = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        while True:
            try:
                urllib.request.urlopen("http://127.0.0.1:7990/").read()
                return time.perf_counter() - began
            except OSError:
                time.sleep(0.02)
    finally:
        server.terminate()
        server.wait()


def click_to_answer(page: Page, file: Path, shots: int) -> tuple[float, float]:
    """s from the click to the table of all shots as the network has them, and to the verified ones."""
    page.get_by_role("tab", name="1 Data").click()
    page.click("#clear")
    page.wait_for_selector("#shots-table table", state="detached")
    page.set_input_files("#upload input[type=file]", str(file))
    page.wait_for_selector("#shots-table table")
    page.wait_for_selector("#overview svg")
    page.wait_for_timeout(1000)
    began = time.perf_counter()
    page.click("#infer-now")
    last = f"document.querySelector('#answers')?.textContent.includes('{file.stem}[{shots}]')"
    page.wait_for_function(f"{last} && document.querySelectorAll('#answers .curves .badge').length === {shots}")
    first = time.perf_counter() - began
    page.wait_for_function(f"{last} && !document.querySelector('#answers .busy')")
    return first, time.perf_counter() - began


def processor_time(tasks: CDPSession) -> float:
    """s of processor time of the page's main thread so far."""
    return next(
        one["value"] for one in tasks.send("Performance.getMetrics")["metrics"] if one["name"] == "TaskDuration"
    )


def main(repeats: int) -> None:
    starts = [start_up() for _ in range(3)]
    few, answers, alone, processor, moves, calls, trials = [], [], [], [], [], [], []
    with TemporaryDirectory() as name, running_server() as (address, visitors), sync_playwright() as driver:
        infer_many(read_curves(many(Path(name), 0, SHOTS))[:2])  # loads network and solver
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=sandbox)
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.on("dialog", lambda dialog: dialog.accept())  # before all files are deleted
        page.goto(address)
        for turn in range(repeats):  # in turns, so that both see the same load
            few.append(click_to_answer(page, many(Path(name), turn, 5), 5))
            file = many(Path(name), turn, SHOTS)
            curves = read_curves(file)
            answers.append(click_to_answer(page, file, SHOTS))
            began, used = time.perf_counter(), time.process_time()
            infer_many(curves)
            alone.append(time.perf_counter() - began)
            processor.append(time.process_time() - used)
        page.click("#to-check")
        page.wait_for_selector("#facts article")
        page.wait_for_timeout(1000)
        session = visitors.session_for("benchmark")
        session.add([steps.examples()["stiff_gel.mat"]], PageSettings(), copy=True)
        steps.infer(session, [session.curves[0].name])
        tasks = page.context.new_cdp_session(page)
        tasks.send("Performance.enable", {"timeDomain": "threadTicks"})
        busy = []
        for k in range(30):
            before = processor_time(tasks)
            drawn, call = page.evaluate(MOVE, 0.2 + 0.6 * (k * 0.618 % 1.0))
            busy.append(1e3 * (processor_time(tasks) - before))
            began = time.perf_counter()
            steps.what_if(session, session.curves[0].name, [30.0, 0.05 + 0.01 * (k % 7), 5.0])
            trials.append(1e3 * (time.perf_counter() - began))
            moves.append(drawn)
            calls.append(call)
            page.wait_for_timeout(100)
        browser.close()
    cores = os.cpu_count() or 1
    print(f"| what (median; {cores} cores, load {os.getloadavg()[0]:.1f}) | |\n|---|---|")
    print(f"| command to page | {median(starts):.1f} s |")
    for shots, found in ((5, few), (SHOTS, answers)):
        first, last = (median(times) for times in zip(*found, strict=True))
        print(f"| click to the network's intervals of {shots} shots | {first:.2f} s |")
        print(f"| click to the verified answers of {shots} shots | {last:.2f} s |")
    print(f"| `infer_many` alone, in turns with it | {median(alone):.2f} s |")
    print(f"| ratio | {median(a / b for (_, a), b in zip(answers, alone, strict=True)):.2f} |")
    print(f"| processor time of `infer_many` / cores | {median(processor) / cores:.2f} s |")
    print(f"| slider to redrawn simulation | {median(moves):.0f} ms |")
    print(f"| of it, processor time of the page | {median(busy):.0f} ms |")
    print(f"| of it, the request | {np.nanmedian(calls):.0f} ms |")
    print(f"| of it, the simulation and its residuals | {median(trials):.0f} ms |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    main(parser.parse_args().repeats)
