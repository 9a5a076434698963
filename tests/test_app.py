"""The browser app without a browser: sessions, limits, the endpoint, the zip. In a browser: test_app_browser.py."""

import json
import os
import signal
import subprocess
import sys
import time
import tomllib
import zipfile
from pathlib import Path
from threading import Event

import numpy as np
import pytest

pytest.importorskip("gradio", reason="the app extra is not installed")

import httpx
from gradio_client import Client, handle_file
from gradio_client.exceptions import AppError
from test_hostile import FILES

from cavirheo.app import steps
from cavirheo.app.apart import Reader
from cavirheo.app.export import write_zip
from cavirheo.app.server import running
from cavirheo.app.session import Limits, Session, Settings, Visitors
from cavirheo.app.steps import answers, examples, fit, infer, sliders, trial
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.reading import read_curves, write_csv

SOFT = examples()["soft_gel.csv"]


@pytest.fixture(scope="module")
def served():
    with running(limits=Limits(file_mb=0.5, files=3)) as (address, visitors):
        yield address, visitors


@pytest.fixture(scope="module")
def client(served):
    return Client(served[0], verbose=False)


@pytest.fixture(scope="module")
def reader():
    one = Reader(seconds=20.0)
    yield one
    one.close()


@pytest.fixture
def session(reader):
    one = Session(Limits(), reader)
    yield one
    one.close()


def silent(*_):
    pass


def single(path, scale=1.0, frames=120):
    """A shot of one file: the first of the example, scaled."""
    curve = read_curves(SOFT)[0]
    write_csv(path, RadiusCurve(curve.time[:frames], curve.radius[:frames] * scale))
    return path


def test_examples_are_shipped():
    assert list(examples()) == ["soft_gel.csv", "stiff_gel.mat"]
    assert [path.name for path in examples().values()] == list(examples())


def test_the_endpoint_answers_as_the_command_line(client, run, tmp_path):
    status, _, _ = run("infer", SOFT, "-o", tmp_path / "out", "--density", 1050, "--window", 2)
    ours = json.loads((tmp_path / "out" / "result.json").read_text())
    theirs = client.predict([handle_file(str(SOFT))], density=1050, window=2, api_name="/infer")
    assert status == 0
    assert len(theirs["curves"]) == 5
    for mine, other in zip(ours["curves"], theirs["curves"], strict=True):
        assert other["source"] == "soft_gel.csv"
        kept = mine.keys() - {"seconds", "source", "group_source"}
        assert {key: other[key] for key in kept} == {key: mine[key] for key in kept}
    assert theirs["groups"] == ours["groups"]


def test_the_endpoint_verifies_as_the_command_line(client, run, tmp_path):
    path = single(tmp_path / "one.csv")
    status, _, _ = run("infer", path, "-o", tmp_path / "out", "--verify", "map")
    (ours,) = json.loads((tmp_path / "out" / "result.json").read_text())["curves"]
    theirs = client.predict([handle_file(str(path))], verify="map", api_name="/infer")
    assert status == 0
    assert theirs["command"].endswith("--verify map")
    for name in ("shear_modulus_Pa", "viscosity_Pa_s", "stretch"):
        assert theirs["curves"][0][name] == ours[name]
        assert ours[name]["q05"] < ours[name]["median"] < ours[name]["q95"]


def test_only_the_endpoint_is_public(client):
    assert list(client.view_api(return_format="dict")["named_endpoints"]) == ["/infer"]
    assert client.view_api(return_format="dict")["unnamed_endpoints"] == {}


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"model": "nonsense"}, "unknown model"),
        ({"model": "../../secret.onnx"}, "unknown model"),
        ({"density": -3.0}, "density"),
        ({"rmax_um": -1.0}, "R_max"),
        ({"window": -1}, "collapse"),
        ({"verify": "surely"}, "none, map or full"),
    ],
)
def test_bad_settings_are_told_to_programs(client, options, says):
    with pytest.raises(AppError, match=says):
        client.predict([handle_file(str(SOFT))], **options, api_name="/infer")


def test_damaged_and_too_many_files_leave_the_server_answering(client, tmp_path):
    bad = tmp_path / "bad.mat"
    bad.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\xff" * 500)
    lines = tmp_path / "long.csv"
    lines.write_bytes(b"1,2\n" * 120_000)
    many = [handle_file(str(single(tmp_path / f"{k}.csv"))) for k in range(4)]
    for files, says in (
        ([handle_file(str(bad))], "bad.mat"),
        ([handle_file(str(lines))], "long.csv"),
        (many, "at most 3"),
    ):
        with pytest.raises(AppError, match=says) as error:
            client.predict(files, api_name="/infer")
        assert str(tmp_path) not in str(error.value)
        assert list(Path(os.environ["GRADIO_TEMP_DIR"]).rglob("*.[cm][sa][vt]")) == []  # refused files do not stay
    assert len(client.predict([handle_file(str(SOFT))], api_name="/infer")["curves"]) == 5


@pytest.mark.slow
def test_hostile_files_leave_the_server_answering(tmp_path):
    """Every file of test_hostile.py, one after the other, to one server."""
    with running() as (address, _):
        client = Client(address, verbose=False)
        for make, (ending, says) in FILES.items():
            path = tmp_path / f"{make.__name__}.{ending}"
            make(path)
            began = time.monotonic()
            with pytest.raises(AppError, match=says):
                client.predict([handle_file(str(path))], api_name="/infer")
            assert time.monotonic() - began < 20.0, make.__name__  # the limit of the reader, whatever the load
            path.unlink()
        assert len(client.predict([handle_file(str(SOFT))], api_name="/infer")["curves"]) == 5


def test_a_file_above_the_limit_is_not_taken(served):
    answer = httpx.post(f"{served[0]}gradio_api/upload", files={"files": ("large.csv", b"1" * 600_000)})
    assert answer.status_code == 413
    assert "maximum allowed size" in answer.text


def test_the_server_fetches_nothing(client):
    file = {"path": "http://192.0.2.1/x.csv", "meta": {"_type": "gradio.FileData"}}
    with pytest.raises(AppError):
        client.predict([file], api_name="/infer")


def test_files_of_the_machine_cannot_be_named(client):
    with pytest.raises(AppError):
        client.predict([{"path": "/etc/hostname", "meta": {"_type": "gradio.FileData"}}], api_name="/infer")


def test_pages_may_ask_nobody_else(served):
    policy = httpx.get(served[0]).headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy


def test_two_visitors_have_their_own_folders_and_are_forgotten(tmp_path):
    visitors = Visitors(Limits(absent=0.05, visitors=2))
    try:
        one, other = visitors.of("one"), visitors.of("other")
        one.add([single(tmp_path / "a.csv")], Settings())
        assert len(one.curves) == 1
        assert other.curves == []
        assert one.folder != other.folder
        assert visitors.of("one") is one
        visitors.of("third")  # the one unused for longest makes room
        assert not other.folder.exists()
        visitors.leave("one")
        assert visitors.of("one") is one  # came back in time
        visitors.leave("one")
        until = time.monotonic() + 10
        while one.folder.exists() and time.monotonic() < until:
            time.sleep(0.01)
        assert not one.folder.exists()
        assert visitors.of("one").curves == []
        last = visitors.of("one").folder
    finally:
        visitors.close()
    assert not last.exists()


def test_files_are_taken_over_read_again_and_told_apart(session, tmp_path):
    (tmp_path / "x").mkdir()
    first, second = single(tmp_path / "a.csv"), single(tmp_path / "x" / "a.csv", 1.5)
    session.add([first, second], Settings())
    assert not first.exists()
    assert [curve.name for curve in session.curves] == ["a", "a (2)"]
    assert {curve.meta["group"] for curve in session.curves} == {"your files"}
    tops = [curve.max_radius for curve in session.curves]
    session.prepare(Settings(rmax_um=300))
    assert [curve.max_radius for curve in session.curves] == pytest.approx([300e-6, 300e-6])
    session.prepare(Settings())
    assert [curve.max_radius for curve in session.curves] == pytest.approx(tops)
    assert all(str(tmp_path) not in str(curve.meta) and "/tmp" not in str(curve.meta) for curve in session.curves)


def test_unreadable_files_are_said_and_not_kept(session, tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("a,b\n1,2\n")
    session.add([bad, single(tmp_path / "good.csv")], Settings())
    assert [path.name for path in session.files] == ["good.csv"]
    assert len(session.problems) == 1
    assert session.problems[0].startswith("bad.csv: ")


def test_too_much_is_refused_and_nothing_of_it_kept(reader, tmp_path):
    session = Session(Limits(files=2, curves=4, frames=200), reader)
    try:
        for files, says in (([tmp_path / "1", tmp_path / "2", tmp_path / "3"], "3 files"), ([SOFT], "5 shots")):
            with pytest.raises(InputError, match=says):
                session.add(files, Settings(), copy=True)
        with pytest.raises(InputError, match="240 frames"):
            session.add([single(tmp_path / "a.csv"), single(tmp_path / "b.csv")], Settings())
        assert session.curves == session.files == []
        assert [path for path in session.folder.rglob("*") if path.is_file()] == []
    finally:
        session.close()


def test_answers_are_forgotten_when_what_they_stand_on_changes(session):
    session.add([SOFT], Settings(), copy=True)
    infer(session, ["soft_gel[2]"], silent)
    assert "soft_gel[2]" in answers(session)
    assert session.command == "cavirheo infer soft_gel.csv (1 of 5 shots)"
    session.prepare(Settings(window=2))
    assert session.pairs == []
    with pytest.raises(InputError, match="choose shots"):
        infer(session, [], silent)


def test_a_stop_keeps_what_is_done_and_names_the_rest(session, monkeypatch):
    session.add([SOFT], Settings(), copy=True)
    names = [curve.name for curve in session.curves]
    hold, real = Event(), steps.infer_many

    def slow(curves, **options):
        if curves[0].name not in names[:2]:
            hold.wait(60)
        return real(curves, **options)

    monkeypatch.setattr(steps, "infer_many", slow)
    infer(session, names, lambda _, said: said.startswith("2 of") and session.stopped.set())
    hold.set()
    assert [curve.name for curve, _ in session.pairs] == names[:2]
    assert session.not_run == names[2:]
    assert "Stopped: 2 of 5 shots done." in answers(session)
    assert "Not run: soft_gel[3], soft_gel[4], soft_gel[5]." in answers(session)
    assert session.command.endswith("(2 of 5 shots)")
    kept = session.pairs
    for run in (lambda: infer(session, names, silent), lambda: fit(session, names[0], silent)):
        with pytest.raises(InputError, match="stopped before a shot was done"):
            run()
    assert session.pairs is kept
    assert session.fits == {}
    session.stopped.clear()
    infer(session, names, silent)
    assert len(session.pairs) == 5
    assert "Stopped" not in answers(session)


def test_one_run_at_a_time_and_none_for_what_has_changed(session):
    session.add([SOFT], Settings(), copy=True)
    said = []

    def again(*_):
        with pytest.raises(InputError) as error:
            infer(session, ["soft_gel[2]"], silent)
        said.append(str(error.value))
        session.prepare(Settings(window=2))

    with pytest.raises(InputError, match="changed while it ran"):
        infer(session, ["soft_gel[1]"], again)
    assert all("the run before goes on" in one for one in said)
    assert said
    assert session.pairs == []


def test_full_uncertainty_is_limited(reader):
    session = Session(Limits(full=4), reader)
    try:
        session.add([SOFT], Settings(verify="full"), copy=True)
        with pytest.raises(InputError, match="5 shots; the page takes at most 4"):
            infer(session, [curve.name for curve in session.curves], silent)
    finally:
        session.close()
    assert session.stopped.is_set()  # whatever still runs for one who is gone


def test_a_reader_that_hangs_or_dies_is_replaced(tmp_path):
    options = {"density": 998.0, "pressure": 101325.0}
    path = single(tmp_path / "a.csv")
    reader = Reader(seconds=60.0)
    try:
        assert len(reader.read([path], **options)[0]) == 1
        os.kill(reader._child.pid, signal.SIGSTOP)
        reader.seconds = 0.2
        with pytest.raises(InputError, match=r"a.csv took more than 0.2 s"):
            reader.read([path], **options)
        reader.seconds = 60.0
        assert len(reader.read([path], **options)[0]) == 1
        os.kill(reader._child.pid, signal.SIGKILL)
        reader._child.join()
        assert len(reader.read([path], **options)[0]) == 1
    finally:
        reader.close()


def test_trials_are_simulations_or_say_that_they_failed(session):
    session.add([SOFT], Settings(), copy=True)
    infer(session, ["soft_gel[1]"], silent)
    start = sliders(session, "soft_gel[1]")
    answer = session.pairs[0][1]
    assert start["shear_modulus"]["value"] == pytest.approx(answer.median("shear_modulus") / 1000, rel=1e-3)
    said, same = trial(session, "soft_gel[1]", [start[key]["value"] for key in start])
    drawn = answer.checks.reconstruction_radius * 1e6
    assert (
        np.max(np.abs(np.interp(answer.checks.reconstruction_time * 1e6, *_si(session, same)) - drawn))
        < 0.02 * drawn[0]
    )
    assert f"RMSE {100 * answer.checks.rmse_over_rmax:.2f}"[:8] in said
    said, failed = trial(session, "soft_gel[1]", [5.0, 0.03, 0.5])
    assert "The simulation failed" in said
    assert failed == {"x": [[], []], "y": [[], []]}


def _si(session, drawn):
    start = session.pairs[0][0].time_of_max * 1e6
    return np.array(drawn["x"][0]) + start, np.array(drawn["y"][0])


def test_a_law_without_modulus_has_no_slider_for_it(session):
    settings = Settings(model="bdt-viscous")
    session.add([SOFT], settings, copy=True)
    infer(session, ["soft_gel[1]"], silent)
    assert sliders(session, "soft_gel[1]")["shear_modulus"] is None
    assert len(trial(session, "soft_gel[1]", [None, 0.03, 8.0])[1]["x"][0]) > 100


def test_the_zip_holds_what_the_command_line_writes_and_the_curves(session, run, tmp_path):
    names = ["soft_gel[1]", "soft_gel[3]"]
    session.add([SOFT], Settings(), copy=True)
    with pytest.raises(InputError, match="nothing to export"):
        write_zip(session)
    infer(session, names, silent)
    fit(session, names[1], silent)
    with zipfile.ZipFile(write_zip(session)) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / "cavirheo-result"
    written = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    documents = {"result.json", "result.csv", "report.html"}
    assert written == {
        *documents, *(f"least-squares/{name}" for name in documents),
        *(f"soft_gel_{k}.{kind}" for k in (1, 3) for kind in ("png", "svg")),
        *(f"least-squares/soft_gel_3.{kind}" for kind in ("png", "svg")),
        *(f"{kind}/soft_gel_{k}.csv" for k in (1, 3) for kind in ("processed", "simulated")),
    }  # fmt: skip
    record = json.loads((folder / "result.json").read_text())["curves"][0]
    (processed,) = read_curves(folder / "processed" / "soft_gel_1.csv")
    (simulated,) = read_curves(folder / "simulated" / "soft_gel_1.csv")
    assert processed.max_radius == pytest.approx(record["max_radius_m"], rel=1e-6)
    frames = (processed.time >= simulated.time[0]) & (processed.time <= simulated.time[-1]) & (processed.radius > 0)
    left = processed.radius[frames] - np.interp(processed.time[frames], simulated.time, simulated.radius)
    rmse = float(np.sqrt(np.mean(left**2)) / record["max_radius_m"])
    assert rmse == pytest.approx(record["rmse_over_rmax"], rel=0.02)
    assert [path for path in session.folder.iterdir() if path.is_dir()] == [session.folder / "your files"]


def test_the_command_line_does_not_wait_for_gradio(tmp_path):
    (tmp_path / "gradio.py").write_text("raise ModuleNotFoundError('no', name='gradio')")
    path = os.pathsep.join([str(tmp_path), *sys.path])
    call = [sys.executable, "-m", "cavirheo"]
    for words, says in ((["--help"], "The same in the browser"), (["app"], 'pip install "cavirheo[app]"')):
        done = subprocess.run(
            [*call, *words], capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}, check=False
        )
        assert says in done.stdout + done.stderr
        assert "Traceback" not in done.stderr


def test_a_port_that_is_taken_is_said(served):
    port = int(served[0].rstrip("/").rpartition(":")[2])
    with pytest.raises(InputError, match="--port"), running(port=port):
        pass


def test_nothing_is_left_when_the_server_ends(tmp_path):
    code = (
        "from cavirheo.app.server import running\n"
        "from cavirheo.app.steps import examples\n"
        "from gradio_client import Client, handle_file\n"
        "if __name__ == '__main__':\n"
        "    with running() as (address, visitors):\n"
        "        visitors.of('someone').add([examples()['soft_gel.csv']], visitors.of('someone').settings, copy=True)\n"
        "        files = [handle_file(str(examples()['soft_gel.csv']))]\n"
        "        Client(address, verbose=False).predict(files, api_name='/infer')\n"
    )
    script = tmp_path / "serve.py"
    script.write_text(code)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    path = os.pathsep.join(sys.path)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": path, "TMPDIR": str(temporary)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    left = [path for path in temporary.rglob("*") if "cavirheo" in path.name or path.is_file()]
    assert left == []


def test_the_space_asks_for_what_the_package_needs():
    root = Path(__file__).parent.parent
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    needed = [*project["dependencies"], *project["optional-dependencies"]["app"]]
    assert (root / "space" / "requirements.txt").read_text().split("\n")[:-1] == needed
