"""The browser app without a browser: sessions, limits, the endpoint, the zip. In a browser: test_app_browser.py."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
import zipfile
from contextlib import closing, contextmanager, suppress
from dataclasses import fields
from importlib.util import find_spec
from multiprocessing import active_children
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest

if find_spec("gradio") is None:
    pytest.skip("the app extra is not installed", allow_module_level=True)

from bombs import FILES

from cavirheo.app.events import uploaded
from cavirheo.app.session import PageSettings, Session, VisitorLimits, Visitors
from cavirheo.app.steps import examples, export, infer, name_materials, preview, sliders, what_if
from cavirheo.app.words import answers, facts, files_table
from cavirheo.curve import RadiusCurve
from cavirheo.errors import InputError
from cavirheo.inference.analysis import Analysis
from cavirheo.inference.what_if import band
from cavirheo.io import read_curves, write_csv
from cavirheo.io.subprocess_reader import Reader
from cavirheo.reporting import browser_figures
from cavirheo.workflow.store import Store

SOFT = examples()["soft_gel.csv"]


@pytest.fixture(scope="session")
def running():
    from cavirheo.app.server import running  # gradio takes seconds, which collecting tests need not wait for

    return running


@pytest.fixture(scope="module")
def served(running):
    with running(limits=VisitorLimits(file_mb=0.5, files=3)) as (address, visitors):
        yield address, visitors


@pytest.fixture(scope="module")
def client(served):
    from gradio_client import Client

    return Client(served[0], verbose=False)


def ask(client, *files, **options):
    """What the endpoint answers for these files."""
    from gradio_client import handle_file

    return client.predict([handle_file(str(file)) for file in files], **options, api_name="/infer")


@contextmanager
def told(message=""):
    """The endpoint refuses with this in its message."""
    from gradio_client.exceptions import AppError

    with pytest.raises(AppError, match=message or None) as error:
        yield error


@pytest.fixture(scope="module")
def reader():
    one = Reader(seconds=20.0)
    yield one
    one.close()


@pytest.fixture
def session(reader):
    one = Session(VisitorLimits(), reader)
    yield one
    one.close()


def silent(*_):
    pass


@contextmanager
def refused(code, *names):
    """Refused with this code, and these words in the message."""
    with pytest.raises(InputError) as error:
        yield
    assert error.value.code == code
    assert all(name in str(error.value) for name in names)


def single(path, scale=1.0, frames=120):
    """A shot of one file: the first of the example, scaled."""
    curve = read_curves(SOFT)[0]
    write_csv(path, RadiusCurve(curve.time[:frames], curve.radius[:frames] * scale))
    return path


def test_the_endpoint_answers_as_the_command_line(client, run, tmp_path):
    path = single(tmp_path / "one.csv")
    run("infer", path, "-o", tmp_path, "--density", 1050, "--window", 2)
    ours = json.loads((tmp_path / "result.json").read_text())
    theirs = ask(client, path, density=1050, window=2)
    assert theirs["command"] == "cavirheo infer one.csv --density 1050 --window 2"
    assert theirs["groups"] == ours["groups"]
    (mine,), (other,) = ours["curves"], theirs["curves"]
    assert mine["shear_modulus_Pa"]["q05"] < mine["shear_modulus_Pa"]["median"] < mine["shear_modulus_Pa"]["q95"]
    kept = mine.keys() - {"seconds", "source", "group_source"}
    assert other["source"] == "one.csv"
    assert {key: other[key] for key in kept} == {key: mine[key] for key in kept}


def test_only_the_endpoint_is_public(client):
    assert list(client.view_api(return_format="dict")["named_endpoints"]) == ["/infer"]
    assert client.view_api(return_format="dict")["unnamed_endpoints"] == {}


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"model": "../../secret.onnx"}, "secret"),
        ({"density": -3.0}, "density"),
        ({"bubble": "helium"}, "helium"),
    ],
)
def test_bad_settings_are_told_to_programs(client, options, named):
    with told(named):
        ask(client, SOFT, **options)


def asked(address, *values):
    """(event, data) that a call without gradio's client ends with."""
    place = f"{address}gradio_api/call/infer"
    sent = urllib.request.Request(place, json.dumps({"data": values}).encode(), {"Content-Type": "application/json"})
    with urllib.request.urlopen(sent) as answer:
        event = json.load(answer)["event_id"]
    said = get(f"{place}/{event}").strip().rpartition("event: ")[2]
    name, _, data = said.partition("\ndata: ")
    return name, json.loads(data or "null")


def test_a_call_by_curl_gives_no_more_than_it_means(served, tmp_path):
    file = {"path": upload(served[0], single(tmp_path / "one.csv")), "meta": {"_type": "gradio.FileData"}}
    event, (document,) = asked(served[0], [file], None, None, 1050, None, None, None, "none")
    assert event == "complete"
    assert document["command"] == "cavirheo infer one.csv --density 1050 --verify none"
    event, said = asked(served[0])
    assert event == "error"
    assert "no curve" in str(said)
    assert "object at" not in str(said)


def test_damaged_and_too_many_files_leave_the_server_answering(client, tmp_path):
    bad = tmp_path / "bad.mat"
    bad.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"\xff" * 500)
    lines = tmp_path / "long.csv"
    lines.write_bytes(b"1,2\n" * 120_000)
    many = [single(tmp_path / f"{k}.csv") for k in range(4)]
    for files, named in (([bad], "bad.mat"), ([lines], "long.csv"), (many, "4 files")):
        with told(named) as error:
            ask(client, *files)
        assert str(tmp_path) not in str(error.value)
        assert list(Path(os.environ["GRADIO_TEMP_DIR"]).rglob("*.[cm][sa][vt]")) == []  # refused files do not stay
    (record,) = ask(client, single(tmp_path / "a.csv"))["curves"]
    assert record["verdict"] == "ok"


def upload(address, path):
    """Where the server keeps it."""
    import httpx

    (kept,) = httpx.post(f"{address}gradio_api/upload", files={"files": (path.name, path.read_bytes())}).json()
    return kept


@pytest.mark.slow
def test_hostile_files_leave_the_server_answering(running, tmp_path, monkeypatch):
    """Every file of bombs.py, one after the other, to one server."""
    from gradio_client import Client

    monkeypatch.setenv("GRADIO_TEMP_DIR", os.environ.get("GRADIO_TEMP_DIR", ""))  # of the server of the other tests

    with running() as (address, _):
        client = Client(address, verbose=False)
        for make, (ending, _) in FILES.items():
            path = tmp_path / f"{make.__name__}.{ending}"
            make(path)
            began = time.monotonic()
            beyond = path.stat().st_size > VisitorLimits().file_mb * 2**20  # is not even sent
            with pytest.raises(ValueError, match="maximum file size") if beyond else told(path.name):
                ask(client, path)
            assert time.monotonic() - began < 20.0, make.__name__  # the limit of the reader, whatever the load
            path.unlink()
        assert len(ask(client, SOFT)["curves"]) == 5


def test_a_file_above_the_limit_is_not_taken(served):
    import httpx

    answer = httpx.post(f"{served[0]}gradio_api/upload", files={"files": ("large.csv", b"1" * 600_000)})
    assert answer.status_code == 413


@pytest.mark.parametrize("place", ["http://192.0.2.1/x.csv", "/etc/hostname"])
def test_nothing_is_fetched_and_no_file_of_the_machine_is_read(client, place):
    with told():
        client.predict([{"path": place, "meta": {"_type": "gradio.FileData"}}], api_name="/infer")


def test_only_what_was_uploaded_is_read_and_removed(tmp_path, monkeypatch):
    """Whatever gradio lets through: another visitor's folder lies outside that of uploads."""
    monkeypatch.setenv("GRADIO_TEMP_DIR", str(tmp_path / "uploads"))
    (tmp_path / "uploads").mkdir()
    sent, other = single(tmp_path / "uploads" / "a.csv"), single(tmp_path / "b.csv")
    (tmp_path / "uploads" / "link.csv").symlink_to(other)
    for wrong in (other, tmp_path / "uploads" / "link.csv", tmp_path / "uploads" / ".." / "b.csv"):
        with refused("app.not_uploaded"), uploaded([str(sent), str(wrong)]):
            pass
    assert other.exists()
    assert sent.exists()
    with uploaded([str(sent)]) as paths:
        assert paths == [sent]
    assert not sent.exists()


def test_pages_may_ask_nobody_else(served):
    import httpx

    policy = httpx.get(served[0]).headers["content-security-policy"]
    assert "default-src 'self'" in policy
    assert "http" not in policy


def test_two_visitors_have_their_own_folders_and_are_forgotten(tmp_path):
    visitors = Visitors(VisitorLimits(absent=0.5, visitors=2))
    try:
        one, other = visitors.of("one"), visitors.of("other")
        one.add([single(tmp_path / "a.csv")], PageSettings())
        assert len(one.curves) == 1
        assert other.curves == []
        assert one.folder != other.folder
        assert visitors.of("one") is one
        forgotten = []
        visitors.forgotten = forgotten.append
        visitors.of("third")  # the one unused for longest makes room
        assert not other.folder.exists()
        assert forgotten == ["other"]
        visitors.leave("one")
        assert visitors.of("one") is one  # came back in time
        visitors.leave("one")
        gone(visitors, "one")  # left twice, forgotten once
        visitors.leave("who did nothing")
        until = time.monotonic() + 10
        while len(forgotten) < 3 and time.monotonic() < until:
            time.sleep(0.01)
        assert forgotten == ["other", "one", "who did nothing"]
        assert visitors.of("one").curves == []
        last = visitors.of("one").folder
    finally:
        visitors.close()
    assert not last.exists()


def gone(visitors, name):
    """This one leaves, and is forgotten."""
    folder = visitors.of(name).folder
    visitors.leave(name)
    until = time.monotonic() + 10
    while folder.exists() and time.monotonic() < until:
        time.sleep(0.01)
    assert not folder.exists()


def test_answers_go_with_the_last_visitor_who_has_them():
    visitors = Visitors(VisitorLimits(absent=0.05))
    try:
        for name in ("one", "other"):
            session = visitors.of(name)
            session.add([SOFT], PageSettings(verify="none"), copy=True)
            infer(session, ["soft_gel[1]"])
            export(session, silent)
        keys = visitors.of("other").keys
        assert visitors.of("one").keys == keys

        def kept():
            return [key for key in keys if visitors.store.get(key, object) or visitors.zips.get(key, object)]

        gone(visitors, "one")
        assert len(kept()) == 2
        gone(visitors, "other")
        assert kept() == []
    finally:
        visitors.close()


def test_files_are_taken_over_read_again_and_told_apart(session, tmp_path):
    (tmp_path / "x").mkdir()
    first, second = single(tmp_path / "a.csv"), single(tmp_path / "x" / "a.csv", 1.5)
    session.add([first, second], PageSettings())
    assert not first.exists()
    assert [curve.name for curve in session.curves] == ["a", "a (2)"]
    assert {curve.meta["group"] for curve in session.curves} == {"your files"}
    tops = [curve.max_radius for curve in session.curves]
    with pytest.raises(InputError) as refused:
        session.prepare(PageSettings(rmax_um=300))  # they differ by half
    assert refused.value.code == "option.several_scales"
    assert [curve.max_radius for curve in session.curves] == pytest.approx(tops)
    assert all(str(tmp_path) not in str(curve.meta) and "/tmp" not in str(curve.meta) for curve in session.curves)


def test_too_much_is_refused_and_nothing_of_it_kept(reader, tmp_path):
    session = Session(VisitorLimits(files=2, curves=4, frames=200), reader)
    try:
        with refused("app.too_many_files", "3"):
            session.add([tmp_path / "1", tmp_path / "2", tmp_path / "3"], PageSettings(), copy=True)
        with refused("app.too_many_frames", "5 shots"):
            session.add([SOFT], PageSettings(), copy=True)
        with refused("app.too_many_frames", "240 frames"):
            session.add([single(tmp_path / "a.csv"), single(tmp_path / "b.csv", 1.01)], PageSettings())
        assert session.curves == session.files == []
        assert [path for path in session.folder.rglob("*") if path.is_file()] == []
    finally:
        session.close()


def test_answers_are_stale_when_settings_change_and_forgotten_when_files_do(session):
    session.add([SOFT], PageSettings(), copy=True)
    infer(session, ["soft_gel[2]"])
    assert "soft_gel[2]" in answers(session)
    assert session.answers.document.command == "cavirheo infer soft_gel.csv (1 of 5 shots)"
    session.prepare(PageSettings(window=2))
    assert session.stale
    assert "run again" in answers(session)
    for asked in (lambda: export(session, silent), lambda: session.find("soft_gel[2]")):
        with pytest.raises(InputError):
            asked()
    session.prepare(PageSettings())
    assert session.find("soft_gel[2]")[0] is session.answers
    with refused("app.no_shots"):
        infer(session, [])
    session.add([SOFT], PageSettings(), copy=True)
    assert session.answers is None


def test_materials_are_typed_and_pooled_anew_without_another_run(session, tmp_path):
    session.store = Store(most=10)
    for k, name in enumerate("abc"):
        session.add([single(tmp_path / f"{name}.csv", 1.0 + 0.1 * k)], PageSettings(verify="none"))
    session.add([SOFT], PageSettings(verify="none"), copy=True)
    names = [curve.name for curve in session.curves]
    first = infer(session, names[:4])
    assert [group.name for group in first.document.groups] == ["your files", "soft_gel"]
    with refused("app.changed"):
        name_materials(session, ["gel"])
    name_materials(session, ["soft_gel", " ", "<gel>", *["soft_gel"] * 5])
    then = session.answers
    assert [(group.name, group.n) for group in then.document.groups] == [
        ("soft_gel", 2),
        ("your files", 1),
        ("<gel>", 1),
    ]
    assert then.document.notes == ["materials that were typed: a = soft_gel, c = <gel>"]
    assert [answer for _, answer in then.pairs] == [answer for _, answer in first.pairs]
    assert "&lt;gel&gt;" in files_table(session)
    assert not session.stale
    name_materials(session, [""] * 8)
    assert session.answers.document.groups == first.document.groups
    assert session.answers.document.notes == []
    session.prepare(PageSettings(verify="none", group="none"))
    kept = dict(zip(names, [answer for _, answer in first.pairs], strict=False))
    pairs = infer(session, names[:4]).pairs
    assert all(answer.theta is kept[curve.name].theta for curve, answer in pairs)  # not computed again


def test_a_material_has_a_density_of_its_own(session, tmp_path):
    for name, scale in (("light", 1.0), ("dense", 1.0001)):  # one recording given twice would be read once
        session.add([single(tmp_path / f"{name}.csv", scale)], PageSettings(verify="none"))
    session.add([examples()["stiff_gel.mat"]], PageSettings(verify="none"), copy=True)  # without seconds
    names, time = [curve.name for curve in session.curves], session.curves[2].time
    blank = [""] * len(names)
    name_materials(session, ["light", "a gel", *blank[2:]], ["", "1050", "1100", *blank[3:]])
    assert np.ptp(session.curves[2].time) == pytest.approx(np.ptp(time) * np.sqrt(1100 / 998))
    document = infer(session, names[:2]).document
    light, dense = document.curves
    assert [one.medium.density for one in document.curves] == [998.0, 1050.0]
    assert dense.shear_modulus_Pa.median > 1.1 * light.shear_modulus_Pa.median
    assert document.command.endswith(f"(2 of {len(names)} shots) ('a gel': --density 1050)")
    assert "density 998 kg/m3" in answers(session)
    assert "of a gel are those of water with changes: density 1050 kg/m3" in answers(session)
    assert 'value="1050"' in files_table(session)
    name_materials(session, ["light", "a gel", *blank[2:]], ["", "1060", *blank[2:]])
    assert session.stale
    with refused("physics.unusual_density"):
        name_materials(session, blank, ["", "1.05", *blank[2:]])
    assert session.densities == {"dense": 1060.0}
    name_materials(session, blank, ["", "1050", "1100", *blank[3:]])
    assert not session.stale
    what_if(session, "dense", [5.0, 0.03, 6.0])


def test_the_command_can_be_typed(session, tmp_path):
    session.add([single(tmp_path / "my gel.csv")], PageSettings(rmax_um=300.0))
    (name,) = [curve.name for curve in session.curves]
    assert infer(session, [name]).document.command == "cavirheo infer 'my gel.csv' --rmax-um 300.0"


def test_odd_input_is_taken_where_the_visitor_vouches_for_it(session, tmp_path):
    _, wrong = PageSettings.of(fields_of(density="1.05"))
    assert list(wrong) == ["density"]
    settings, wrong = PageSettings.of(fields_of(density="1.05", trust_input=True))
    assert (wrong, settings.liquid.density) == ({}, 1.05)
    session.add([single(tmp_path / "gel.csv", 0.4)], PageSettings())  # too fast for so small a bubble
    assert infer(session, ["gel"]).document.curves[0].verdict == "check_input"
    session.prepare(PageSettings(trust_input=True))
    made = infer(session, ["gel"]).document
    assert made.curves[0].verdict != "check_input"
    assert made.command == "cavirheo infer gel.csv --trust-input"


def test_a_glance_of_the_network_is_never_trusted(session, tmp_path):
    (tmp_path / "short.csv").write_text("time_us,radius_um\n" + "".join(f"{k},{100 - k * k}\n" for k in range(3)))
    session.add([single(tmp_path / "one.csv"), tmp_path / "short.csv"], PageSettings())
    for settings in (PageSettings(material="auto"), PageSettings(model="bdt-viscous"), PageSettings(verify="none")):
        session.prepare(settings)
        preview(session, ["one"])
        assert session.previews == {}  # these wait for their answers
    session.prepare(PageSettings())
    preview(session, ["one", "short"])
    assert list(session.previews) == ["one"]  # of a shot that it cannot answer it says nothing
    name_materials(session, ["gel", ""])
    preview(session, ["one"])
    assert session.previews["one"].group == "gel"
    row = session.previews["one"]
    assert row.shear_modulus_Pa.q05 < row.shear_modulus_Pa.median < row.shear_modulus_Pa.q95
    assert not row.trusted
    assert "Answers marked" in answers(session)
    assert session.answers is None
    assert [record.verdict for record in infer(session, ["one", "short"]).document.curves] == ["ok", "failed"]
    assert session.previews == {}
    assert "Answers marked" not in answers(session)


def test_one_run_at_a_time_and_none_for_what_has_changed(session, monkeypatch):
    session.add([SOFT], PageSettings(verify="none"), copy=True)
    asked, real = [], Analysis.answer

    def again(analysis, curve, **options):
        asked.append(True)
        with refused("parallel.busy"):
            infer(session, ["soft_gel[2]"])
        session.clear()
        return real(analysis, curve, **options)

    monkeypatch.setattr(Analysis, "answer", again)
    with refused("app.changed"):
        infer(session, ["soft_gel[1]"])
    assert asked
    assert session.answers is None


def fields_of(**typed):
    """What stands in the fields of the page, in their order."""
    usual = {field.name: getattr(PageSettings, field.name) for field in fields(PageSettings)}
    return [*(usual | {"density": "", "window": 0} | typed).values()]


def test_the_fields_of_the_page_are_settings_or_say_why_not():
    settings, wrong = PageSettings.of(fields_of(density="1050", window=2))
    assert (settings, wrong) == (PageSettings(density=1050.0, window=2), {})
    _, wrong = PageSettings.of(fields_of(density="1,050", stretch="0.5"))
    assert list(wrong) == ["density", "stretch"]
    assert "two ways" in wrong["density"]
    _, wrong = PageSettings.of(fields_of(material="auto", verify="none"))
    assert list(wrong) == [""]  # neither is wrong alone


def test_full_uncertainty_is_limited(reader):
    session = Session(VisitorLimits(full=4), reader)
    try:
        session.add([SOFT], PageSettings(verify="full"), copy=True)
        with refused("app.too_many_full", "5 shots", "at most 4"):
            infer(session, [curve.name for curve in session.curves])
    finally:
        session.close()
    assert session.work.stopped.is_set()  # whatever still runs for one who is gone


@contextmanager
def begun(make):
    """What `make` makes, closed at the end, and what stops its one process by a signal."""
    before = {*active_children()}

    def stop(number):
        (child,) = {*active_children()} - before
        os.kill(child.pid, number)

    with closing(make()) as made:
        yield made, stop


def test_a_reader_that_hangs_or_dies_is_replaced(tmp_path, monkeypatch):
    path, options = single(tmp_path / "a.csv"), {"density": 998.0, "pressure": 101325.0}
    with begun(lambda: Reader(seconds=20.0)) as (reader, stop):
        stop(signal.SIGSTOP)
        with monkeypatch.context() as soon, refused("app.reading_too_slow", "a.csv", "0.1 s"):
            soon.setattr(reader, "seconds", 0.1)
            reader.read([path], **options)
        stop(signal.SIGKILL)
        with suppress(InputError):  # found dead before the file is sent, or while it is read
            reader.read([path], **options)
        assert len(reader.read([path], **options)[0]) == 1


def suppressed(work, *given):
    with suppress(InputError):
        work(*given)


def test_a_file_that_takes_long_lets_other_visitors_read(tmp_path):
    with begun(lambda: Visitors(VisitorLimits(seconds=8.0))) as (visitors, stop):
        slow, quick = visitors.of("slow"), visitors.of("quick")
        stop(signal.SIGSTOP)
        waiting = Thread(target=suppressed, args=(slow.add, [single(tmp_path / "a.csv")], PageSettings()))
        waiting.start()
        time.sleep(0.2)
        quick.add([single(tmp_path / "b.csv")], PageSettings())
        assert waiting.is_alive()
        waiting.join()
        assert (len(slow.curves), len(quick.curves)) == (0, 1)


def test_trials_are_simulations_or_say_that_they_failed(session):
    session.add([SOFT], PageSettings(), copy=True)
    infer(session, ["soft_gel[1]"])
    start = sliders(session, "soft_gel[1]")
    _, curve, answer, _ = session.find("soft_gel[1]")
    assert start["shear_modulus"]["value"] == pytest.approx(answer.best["shear_modulus"] / 1000, rel=1e-3)
    assert start["stretch"]["value"] == pytest.approx(answer.best["stretch"], rel=1e-3)
    found, same = what_if(session, "soft_gel[1]", [start[key]["value"] for key in start])
    assert found.rmse_over_rmax == pytest.approx(answer.checks.rmse_over_rmax, rel=0.01)
    time, radius = answer.checks.reconstruction_time, answer.checks.reconstruction_radius
    drawn = np.interp(time, np.array(same["x"][0]) * 1e-6 + curve.time_of_max, np.array(same["y"][0]) * 1e-6)
    assert np.max(np.abs(drawn - radius)) < 0.02 * radius[0]
    found, failed = what_if(session, "soft_gel[1]", [5.0, 0.03, 0.5])
    assert (found.verdict, "stretch" in found.message) == ("failed", True)
    assert failed == {"x": [[], []], "y": [[], []]}


def test_the_zip_holds_the_documents_and_the_curves_and_the_sliders_draw_them(session, tmp_path):
    """The values of an exported simulation, typed into the sliders, give the RMSE that is shown."""
    session.add([SOFT], PageSettings(), copy=True)
    with refused("app.no_answer"):
        export(session, silent)
    kept = infer(session, ["soft_gel[1]"])
    made, _ = export(session, silent)
    with zipfile.ZipFile(made) as archive:
        archive.extractall(tmp_path)
    folder = tmp_path / "cavirheo-result"
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert {"result.json", "result.csv", "report.html", "processed/soft_gel_1.csv"} <= names
    path = folder / "simulated" / "soft_gel_1-best-draw.csv"
    said = path.read_text(encoding="utf-8").splitlines()[0]
    typed = [float(re.search(rf"{symbol} = ([\d.]+)", said)[1]) for symbol in ("G", "µ", "λ")]
    found, _ = what_if(session, "soft_gel[1]", typed)
    (record,) = kept.document.curves
    assert found.rmse_over_rmax == pytest.approx(record.rmse_over_rmax, rel=0.005)
    assert said.partition(", ")[2] in facts(session, "soft_gel[1]")
    (processed,), (simulated,) = read_curves(folder / "processed" / "soft_gel_1.csv"), read_curves(path)
    frames = (processed.time >= simulated.time[0]) & (processed.time <= simulated.time[-1]) & (processed.radius > 0)
    left = processed.radius[frames] - np.interp(processed.time[frames], simulated.time, simulated.radius)
    assert np.sqrt(np.mean(left**2)) / record.max_radius_m == pytest.approx(record.rmse_over_rmax, rel=0.05)


def test_the_band_of_the_draws_holds_the_answer_and_a_density_matters(session):
    session.add([SOFT], PageSettings(), copy=True)
    kept = infer(session, ["soft_gel[1]"])
    _, curve, answer, _ = session.find("soft_gel[1]")
    time, low, high = band(curve, answer, session.settings.analysis)
    assert np.array_equal(time, answer.checks.reconstruction_time)
    inside = (answer.checks.reconstruction_radius >= low) & (answer.checks.reconstruction_radius <= high)
    assert np.mean(inside) > 0.7
    change = kept.document.groups[0].modulus_over_scale  # a denser liquid is slower, which a stiffer gel makes up for
    assert 5.0 < change < 25.0
    shown = browser_figures.cloud(kept.pairs, kept.document)
    (medians,) = [one for one in shown.data if one.text is not None]
    assert medians.y[0] == pytest.approx(answer.median("viscosity"))  # over G, as in the report
    assert medians.x[0] == pytest.approx(answer.median("shear_modulus") / 1000)


def test_a_link_leads_back_to_a_session_and_no_other_word_does():
    visitors = Visitors(VisitorLimits())
    try:
        one = visitors.of("page")
        assert visitors.back("reloaded", one.link) is one
        assert visitors.of("reloaded") is one
        assert visitors.back("stranger", "") is visitors.back("stranger", one.link + "x") is None
        assert visitors.of("stranger") is not one
    finally:
        visitors.close()


def test_a_short_call_of_a_program_does_not_wait_for_a_long_one(served, client, tmp_path, monkeypatch):
    from gradio_client import handle_file

    hold, begun, real = Event(), Event(), Analysis.answer

    def held(analysis, curve, **options):
        if curve.name == "long":  # asked nowhere else: an answer that is kept would not be held
            begun.set()
            hold.wait(60)
        return real(analysis, curve, **options)

    monkeypatch.setattr(Analysis, "answer", held)
    file = handle_file(str(single(tmp_path / "long.csv", 1.037)))
    long = client.submit([file], verify="none", api_name="/infer")
    assert begun.wait(60)
    assert len(ask(client, single(tmp_path / "b.csv"), verify="none")["curves"]) == 1
    assert not long.done()
    hold.set()
    assert len(long.result()["curves"]) == 1


def test_the_command_line_does_not_wait_for_gradio(tmp_path):
    (tmp_path / "gradio.py").write_text("raise ModuleNotFoundError('no', name='gradio')")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    call = [sys.executable, "-m", "cavirheo", "app"]
    done = subprocess.run(call, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2
    assert "cavirheo[app]" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_port_that_is_taken_is_said(running, served):
    port = int(served[0].rstrip("/").rpartition(":")[2])
    with refused("app.port_taken", str(port)), running(port=port):
        pass


def get(address: str) -> str:
    with urllib.request.urlopen(address) as answer:
        return answer.read().decode()


def test_the_wall_shows_the_answers_of_a_session_to_who_knows_its_link(served, monkeypatch):
    address, visitors = served
    one = visitors.of("who asks")
    own = f"{address}live?session={one.link}"
    assert "waiting" in get(own)
    one.add([SOFT], PageSettings(verify="map"), copy=True)
    infer(one, ["soft_gel[1]", "soft_gel[2]", "soft_gel[3]"])
    page = get(own)
    assert "<h1>soft_gel[3]</h1>" in page
    assert "still wanted" in page
    assert "waiting" in get(f"{address}live")  # a proxy on this machine asks for whoever there is
    monkeypatch.setattr(visitors, "limits", VisitorLimits(absent=0.05))
    gone(visitors, "who asks")
    assert "waiting" in get(own)  # nothing of one who left


def test_a_folder_that_is_none_is_refused(run):
    status, out, err = run("app", "--live", "nowhere", "--no-browser")
    assert (status, out) == (2, "")
    assert "nowhere" in err
    assert "watch" in err


def test_nothing_is_left_when_the_server_ends(tmp_path):
    """Neither what a visitor loaded nor an upload that nobody read."""
    call = [sys.executable, "-m", "cavirheo", "app", "--no-browser", "--port", "0"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TMPDIR": str(tmp_path)}
    with subprocess.Popen(call, stderr=subprocess.PIPE, text=True, env=environment) as server:
        address = re.search(r"http\S+", server.stderr.readline())[0]
        assert Path(upload(address, SOFT)).is_relative_to(tmp_path)
        server.terminate()
        said = server.stderr.read()
    assert server.returncode == 0, said
    assert [path for path in tmp_path.rglob("*") if "cavirheo" in path.name or path.is_file()] == []
