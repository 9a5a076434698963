"""The app without a browser (test_app_browser.py has one): sessions, limits, endpoint, zip, and recordings."""

import json
import os
import re
import subprocess
import sys
import zipfile
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from socket import socket
from threading import Event

import httpx
import numpy as np
import pytest
from answers import same
from bombs import abort
from conftest import ANSWER, ROOT, code_of, error_of, refused, until
from files import write_curve
from recordings import RATE, SCALE, film

from cavirheo import RadiusCurve, read_curves
from cavirheo.app.page import uploaded_paths
from cavirheo.app.reader import Reader
from cavirheo.app.session import EXAMPLES, PAGE_FIELDS, PageSettings, VisitorLimits, Visitors
from cavirheo.app.words import shots_table

SOFT = EXAMPLES["soft_gel.csv"]


def serving(**how):
    from cavirheo.app.server import running_server  # gradio takes seconds, which collecting tests need not wait for

    return running_server(**how)


@pytest.fixture(scope="module")
def served():
    with serving(limits=VisitorLimits(file_mb=0.5, files=3)) as (address, visitors):
        yield address, visitors


@pytest.fixture(scope="module")
def client(served):
    from gradio_client import Client

    return Client(served[0], verbose=False)


def ask(client, *files, call="predict", **options):
    from gradio_client import handle_file

    return getattr(client, call)([handle_file(str(file)) for file in files], **options, api_name="/infer")


def told(message=""):
    """The endpoint refuses with this in its message."""
    from gradio_client.exceptions import AppError

    return pytest.raises(AppError, match=message or None)


@pytest.fixture
def session():
    with closing(Visitors(VisitorLimits(read_seconds=60.0))) as visitors:
        yield visitors.session_for("one")


CAMERA, QUICK = PageSettings(fps=RATE, um_per_px=SCALE), PageSettings(model="bdt-viscoelastic")
DRAWS = PageSettings(material="nhkv", bubble="field")  # some seconds a shot


def single(path, scale=1.0, frames=160):
    """A shot of one file: the first of the example, scaled."""
    curve = read_curves(SOFT)[0]
    write_curve(path, RadiusCurve(curve.time[:frames], curve.radius[:frames] * scale))
    return path


def test_the_endpoint_answers_as_the_command_line(client, run, tmp_path):
    path = single(tmp_path / "my gel.csv", 0.4)  # too fast for so small a bubble, unless the visitor vouches for it
    words = "--density 1050 --window 2 --material newtonian --bubble field --trust-input"
    run("infer", path, "-o", tmp_path, *words.split())
    ours = json.loads((tmp_path / "result.json").read_text())
    options = {"density": 1050, "window": 2, "material": "newtonian", "bubble": "field", "trust_input": True}
    theirs = ask(client, path, **options)
    assert theirs["command"] == f"cavirheo infer 'my gel.csv' {words}"
    assert theirs["groups"] == ours["groups"]
    for (record,) in (ours["curves"], theirs["curves"]):
        for key in ("seconds", "source", "group_source"):
            assert record.pop(key)
    assert theirs["curves"] == ours["curves"]
    assert ours["curves"][0]["verdict"] != "check_input"


def test_bad_settings_are_told_to_programs(client):
    wrong = {"secret": {"model": "../../secret.npz"}, "density": {"density": -3.0}, "helium": {"bubble": "helium"}}
    wrong |= {"no such law|unknown|material": {"material": "jelly"}, "are excluded of recordings": {"exclude": "3"}}
    for named, settings in wrong.items():
        with told(named):
            ask(client, SOFT, **settings)


def test_damaged_and_too_many_files_leave_the_server_answering(client, tmp_path):
    (tmp_path / "bad.mat").write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\xff" * 500)
    (tmp_path / "long.csv").write_bytes(b"1,2\n" * 120_000)
    many = [single(tmp_path / f"{k}.csv") for k in range(4)]
    for files, named in (([tmp_path / "bad.mat"], "bad.mat"), ([tmp_path / "long.csv"], "long.csv"), (many, "4 files")):
        with told(named) as error:
            ask(client, *files)
        assert str(tmp_path) not in str(error.value)
        assert list(Path(os.environ["GRADIO_TEMP_DIR"]).rglob("*.[cm][sa][vt]")) == []  # refused files do not stay
    (record,) = ask(client, many[0], model=QUICK.model)["curves"]
    assert record["material"] == "nhkv"


def upload(address, content):
    return httpx.post(f"{address}gradio_api/upload", files={"files": ("sent.csv", content)})


def test_only_the_endpoint_is_public_and_nothing_is_fetched(served, client):
    api = client.view_api(return_format="dict")
    assert (list(api["named_endpoints"]), api["unnamed_endpoints"]) == (["/infer"], {})
    options = [option["parameter_name"] for option in api["named_endpoints"]["/infer"]["parameters"]]
    assert options == ["files", *PAGE_FIELDS]
    policy = httpx.get(served[0]).headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy
    assert upload(served[0], b"1" * 600_000).status_code == 413
    for place in ("http://192.0.2.1/x.csv", "/etc/hostname"):
        with told():
            client.predict([{"path": place, "meta": {"_type": "gradio.FileData"}}], api_name="/infer")


def test_only_what_was_uploaded_is_read_and_removed(tmp_path, monkeypatch):
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(tmp_path / "uploads"))
    (tmp_path / "uploads").mkdir()
    sent, other = single(tmp_path / "uploads" / "a.csv"), single(tmp_path / "b.csv")
    (tmp_path / "uploads" / "link.csv").symlink_to(other)
    for wrong in (other, tmp_path / "uploads" / "link.csv", tmp_path / "uploads" / ".." / "b.csv"):
        with refused("app.not_uploaded"), uploaded_paths([str(sent), str(wrong)]):
            pass
    with uploaded_paths([str(sent)]) as paths:
        assert paths == [sent]
    assert (other.exists(), sent.exists()) == (True, False)


def test_two_visitors_have_their_own_folders_and_are_forgotten_with_their_last_page(tmp_path):
    with closing(Visitors(VisitorLimits(absent_seconds=0.5, visitors=2))) as visitors:
        one, other = visitors.session_for("one"), visitors.session_for("other")
        one.add([single(tmp_path / "a.csv")], PageSettings())
        assert (len(one.curves), other.curves) == (1, [])
        assert one.folder != other.folder
        assert visitors.session_for("one") is one
        visitors.session_for("third")  # the one unused for longest makes room
        assert not other.folder.exists()
        visitors.leave("one")
        assert visitors.session_for("one") is one  # came back in time
        gone(visitors, "one")
        last = visitors.session_for("one")
        assert last.curves == []
        assert visitors.reopen("reloaded", last.link) is visitors.session_for("reloaded") is last
        assert visitors.reopen("stranger", "") is visitors.reopen("stranger", last.link + "x") is None
        assert visitors.session_for("stranger") is not last
    assert not last.folder.exists()


def gone(visitors, name):
    folder = visitors.session_for(name).folder
    visitors.leave(name)
    until(lambda: visitors.forget_absent() or not folder.exists())


def test_answers_are_forgotten_with_the_last_visitor_who_has_them():
    with closing(Visitors(VisitorLimits(absent_seconds=0.05))) as visitors:
        for name in ("one", "other"):
            session = visitors.session_for(name)
            session.add([SOFT], QUICK, copy=True)
            session.infer(["soft_gel[1]"])
        gone(visitors, "one")
        assert len(visitors.shared) == 1
        del session
        gone(visitors, "other")
        until(lambda: not visitors.shared)


def test_files_are_taken_over_read_again_and_told_apart(session, tmp_path):
    (tmp_path / "x").mkdir()
    first, second = single(tmp_path / "a.csv"), single(tmp_path / "x" / "a.csv", 1.5)
    session.add([first, second], PageSettings())
    assert not first.exists()
    assert [curve.name for curve in session.curves] == ["a", "a (2)"]
    assert {curve.meta["group"] for curve in session.curves} == {"your files"}
    with refused("option.several_scales"):
        session.apply_settings(PageSettings(rmax_um=300))  # they differ by half
    assert all(str(tmp_path) not in str(curve.meta) and "/tmp" not in str(curve.meta) for curve in session.curves)


def test_answers_are_of_their_settings_and_files(session):
    session.add([SOFT], QUICK, copy=True)
    for asked, code in ((session.export, "app.no_answer"), (lambda: session.infer([]), "app.no_shots")):
        assert code_of(asked) == code
    first = session.infer(["soft_gel[2]"])
    assert first.document.command == "cavirheo infer soft_gel.csv --model bdt-viscoelastic (1 of 5 shots)"
    session.apply_settings(PageSettings(window=2))
    for asked in (session.export, lambda: session.find_answer("soft_gel[2]"), lambda: session.find_answer(None)):
        with refused("app.no_answer", "no answer yet"):
            asked()
    session.apply_settings(replace(QUICK, exposure_us=0.4))
    with refused("option.idle", "--exposure-us"):
        session.infer(["soft_gel[2]"])
    session.apply_settings(QUICK)
    again = session.infer(["soft_gel[2]"])
    assert again.pairs[0][1].theta is first.pairs[0][1].theta  # it was kept
    session.add([SOFT], QUICK, copy=True)
    assert session.answers is None


def test_which_shots_are_one_material_is_chosen(session, tmp_path):
    for k, name in enumerate(("gel_1", "gel_2", "<b>")):
        session.add([single(tmp_path / f"{name}.csv", 1.02 + 0.04 * k)], QUICK)
    first = session.infer(session.names)
    assert [group.name for group in first.document.groups] == ["your files"]
    session.apply_settings(replace(QUICK, group="name"))
    groups = [(group.name, group.n) for group in session.infer(session.names).document.groups]
    assert groups == [("gel", 2), ("<b>", 1)]
    assert "<td>&lt;b&gt;</td>" in shots_table(session)


def test_one_run_at_a_time_and_none_for_what_has_changed(session, monkeypatch):
    session.add([SOFT], QUICK, copy=True)
    answer = resolve_name(ANSWER)

    def again(analysis, curve, **options):
        with refused("parallel.busy"):
            session.infer(["soft_gel[2]"])
        session.clear()
        return answer(analysis, curve, **options)

    monkeypatch.setattr(ANSWER, again)
    with refused("app.changed"):
        session.infer(["soft_gel[1]"])
    assert session.answers is None


TYPED = [  # into the fields, and those that are wrong; the number that is read
    ({"density": "1002.5", "window": 2}, [], 1002.5),
    ({"density": "1,050", "stretch": "0.5"}, ["density", "stretch"], None),
    ({"density": "1.05"}, ["density"], None),
    ({"fps": "270.000", "um_per_px": "-1"}, ["fps", "um_per_px"], None),
    ({"exclude": "12, 40-45", "exposure_us": "0.4"}, [], None),
    ({"exclude": "x", "exposure_us": "0"}, ["exposure_us", "exclude"], None),
    ({"bubble": "auto"}, ["bubble"], None),
    ({"material": "auto", "model": "bdt-viscous"}, [], None),
    ({"material": "newtonian", "model": "bdt-viscoelastic"}, ["leave out material 'newtonian'"], None),
]


@pytest.mark.parametrize(("typed", "wrong", "density"), TYPED)
def test_the_fields_of_the_page_are_settings_or_say_why_not(typed, wrong, density):
    values = {"density": "", "window": ""} | typed
    if not wrong:
        assert PageSettings(**values).density == density
        return
    message = str(error_of(PageSettings, **values))
    assert any(name in message for name in wrong)


def test_a_reader_that_hangs_or_dies_costs_one_call(tmp_path, monkeypatch):
    path, options = single(tmp_path / "a.csv"), {"density": 998.0, "pressure": 101325.0}
    reader = Reader(seconds=0.01)
    with refused("limits.time", "a.csv", "0.01 s"):
        reader.read(tmp_path, [path.name], **options)
    reader.seconds = 60.0
    with monkeypatch.context() as broken, refused("reading.ended", "a.csv"):
        broken.setattr("cavirheo.app.reader.read_in_folder", abort)
        reader.read(tmp_path, [path.name], **options)
    assert len(reader.read(tmp_path, [path.name], **options)[0]) == 1


def test_the_zip_holds_the_documents_and_the_curves_and_the_sliders_draw_them(session, tmp_path):
    """The values of an exported simulation, typed into the sliders, give the RMSE that is shown."""
    session.add([SOFT], PageSettings(material="nhkv"), copy=True)
    (record,) = session.infer(["soft_gel[1]"]).document.curves
    with zipfile.ZipFile(session.export()) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / "cavirheo-result"
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert {"result.json", "result.csv", "report.html", "processed/001_soft_gel_1.csv"} <= names
    path = folder / "simulated" / "001_soft_gel_1-best-draw.csv"
    typed = [1e-3 * record.best["shear_modulus"], record.best["viscosity"], record.best["stretch"]]
    assert [one["value"] for one in session.sliders("soft_gel[1]").values()] == pytest.approx(typed, rel=1e-2)
    assert session.what_if("soft_gel[1]", typed).rmse_over_rmax == pytest.approx(record.rmse_over_rmax, abs=1e-3)
    (processed,), (simulated,) = read_curves(folder / "processed" / "001_soft_gel_1.csv"), read_curves(path)
    frames = (processed.time >= simulated.time[0]) & (processed.time <= simulated.time[-1]) & (processed.radius > 0)
    left = processed.radius[frames] - np.interp(processed.time[frames], simulated.time, simulated.radius)
    assert np.sqrt(np.mean(left**2)) / record.max_radius_m == pytest.approx(record.rmse_over_rmax, rel=0.05)
    assert session.what_if("soft_gel[1]", [5.0, 0.03, 0.5]).verdict == "failed"
    assert "viscosity must be a number, got 'low'" in str(error_of(session.what_if, "soft_gel[1]", [5.0, "low", 7.0]))


def test_a_short_call_of_a_program_does_not_wait_for_a_long_one(client, tmp_path, monkeypatch):
    hold, begun, real = Event(), Event(), resolve_name(ANSWER)

    def held(analysis, curve, **options):
        if curve.name == "long":  # asked nowhere else: an answer that is kept would not be held
            begun.set()
            hold.wait(60)
        return real(analysis, curve, **options)

    monkeypatch.setattr(ANSWER, held)
    long = ask(client, single(tmp_path / "long.csv", 1.037), call="submit", model=QUICK.model)
    assert begun.wait(60)
    assert len(ask(client, single(tmp_path / "b.csv"), model=QUICK.model)["curves"]) == 1
    assert not long.done()
    hold.set()
    assert len(long.result()["curves"]) == 1


def test_a_port_that_is_taken_is_said(served):
    port = int(served[0].rstrip("/").rpartition(":")[2])
    with refused("app.port_taken", str(port)), serving(port=port):
        pass


SPACE = pytest.param([ROOT / "packaging" / "space" / "app.py"], marks=pytest.mark.repository, id="space")


@pytest.mark.parametrize("words", [["-m", "cavirheo", "app", "--no-browser", "--port", "0"], SPACE])
def test_nothing_is_left_when_the_server_ends(tmp_path, words):
    with socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    about = {"TMPDIR": str(tmp_path), "PYTHONPATH": os.pathsep.join(sys.path), "GRADIO_SERVER_PORT": port}
    how = {"stderr": subprocess.PIPE, "text": True, "env": os.environ | about}
    with subprocess.Popen([sys.executable, *words], **how) as server:
        address = next(filter(None, (re.search(r"http:\S+", line) for line in server.stderr)))[0]
        (kept,) = upload(address, SOFT.read_bytes()).json()
        assert Path(kept).is_relative_to(tmp_path)
        server.terminate()
        said = server.stderr.read()
    assert server.returncode == 0, said
    assert [path for path in tmp_path.rglob("*") if "cavirheo" in path.name or path.is_file()] == []


@pytest.fixture
def recording(tmp_path):
    pytest.importorskip("av")
    film().save(tmp_path / "shot.tif")
    return tmp_path / "shot.tif"


def test_a_recording_is_the_shot_of_the_command_line(session, recording, tmp_path):
    settings = replace(CAMERA, exclude="6,12-14", exposure_us=0.5)
    session.add([recording], settings, copy=True)
    (mine,) = session.curves
    camera = {"frame_rate_hz": RATE, "um_per_px": SCALE, "exposure": 0.5e-6}
    (theirs,) = read_curves(recording, **camera, exclude="6,12-14")
    assert same([mine.time, mine.radius, mine.radius_std], [theirs.time, theirs.radius, theirs.radius_std])
    assert (mine.notes, mine.exposure) == (theirs.notes, theirs.exposure)


def test_a_recording_waits_for_its_rate_and_scale_and_is_measured_once(session, recording, tmp_path, monkeypatch):
    (tmp_path / "other.csv").write_text("time_us,radius_um\n" + "".join(f"{k},{100 - k * k}\n" for k in range(8)))
    session.add([recording, tmp_path / "other.csv"], PageSettings(), copy=True)
    assert (session.names, "--fps" in session.problems[0]) == (["other"], True)
    session.apply_settings(CAMERA)
    assert (session.names, session.problems) == (["other", "shot"], [])
    first = session.curves[1]
    with monkeypatch.context() as patched:
        patched.setattr(session.visitors, "measurer", None)  # not needed again
        session.apply_settings(replace(CAMERA, density=1050.0))
    assert same([session.curves[1].radius], [first.radius])
    session.apply_settings(replace(CAMERA, exclude="20"))
    assert np.isnan(session.curves[1].radius[19])
    session.add([EXAMPLES["bubble.mp4"]], CAMERA, copy=True)
    with refused("option.exclude"):
        session.apply_settings(replace(CAMERA, exclude="20"))
    session.clear()
    assert (session.files, session.names) == ([], [])


def test_a_gradio_without_the_private_names_serves_the_page(monkeypatch):
    from gradio import blocks, processing_utils, route_utils

    monkeypatch.delattr(processing_utils, "async_ssrf_protected_download")
    monkeypatch.delattr(route_utils, "GradioUploadFile")
    monkeypatch.delattr(blocks.Blocks, "validate_inputs")
    with serving() as (address, visitors):
        assert httpx.get(address).status_code == 200
        visitors.on_forget("a page")
