"""The page: what it shows is the live document, and nobody else gets at it."""

from __future__ import annotations

import html
import http.client
import json
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pytest

from gcs_sysid.dashboard import app, server
from gcs_sysid.dashboard.app import COOKIE, MOST_CLIENTS
from gcs_sysid.dashboard.watch import KEPT, Watch, point
from gcs_sysid.errors import InputError
from tests.dashboard import browser as browsers
from tests.dashboard.browser import CHROMIUM, Browser
from tests.report.test_palette import contrast

ASSETS = Path(app.__file__).with_name("assets")
PATIENCE_S = 20.0


def live(**parts: object) -> dict:
    """A live document as listening writes it."""
    return {
        "schema": 1, "program": "gcs-sysid 0", "command": "listen", "link": "udp:127.0.0.1:1",
        "aircraft": "A <b>bold</b> aircraft", "vehicle": 1, "other_vehicles": [],
        "phase": "flying", "time_us": 1, "written_us": time.time_ns() // 1000, "state_age_s": 0.02,
        "health": {
            "up": True, "why": "", "losses": 0, "silence_s": 0.0,
            "streams": {"RAW_IMU": {"rate_hz": 49.7, "age_s": 0.01}},
            "requests": {
                "RAW_IMU": {"wanted_hz": 50.0, "rate_hz": 49.7, "answer": "enough"},
                "AOA_SSA": {"wanted_hz": 25.0, "rate_hz": 0.0, "answer": "refused"},
            },
        },
        "state": {
            "V": {"value": 21.34, "sd": 0.5, "unit": "m/s"},
            "alpha": {"value": 0.1, "sd": 0.01, "unit": "rad"},
        },
        "coefficients": {"CZ": {"value": -0.4567, "sd": 0.01, "age_s": 0.3}},
        "derivatives": {"CZ": {"alpha": {"value": -4.5, "sd": 0.25}}},
        "derivatives_by": "inside the filter",
        "inside": {
            "phase": "known",
            "lost": 1,
            "refused": "gusts that last <0.3 s>",
            "age_s": 0.8,
            "wanted_s": 60.0,
        },
        "departures": {
            "CZ": {"since_us": -11_999_999, "size": 0.1, "deviations": 4.2, "derivative": None},
            "Cm": {"since_us": -2_999_999, "size": 0.3, "deviations": 5.0, "derivative": "<q>"},
        },
        "causes": [
            {"cause": "surface_effectiveness", "about": "<i>elevator</i>", "probability": 0.9996,
             "log_bayes_factor": 9.0, "size": -0.346, "sd": 0.02, "unit": "1"},
            {"cause": "cg_shift", "about": "", "probability": 0.02,
             "log_bayes_factor": 4.0, "size": -0.0622, "sd": 0.004, "unit": "mean chords forward"},
        ],
        "alarms": [
            {"kind": "frozen", "what": "VFR_HUD", "since_us": 1,
             "words": "VFR_HUD repeats itself for 4 s and is left out"},
        ],
        "maneuver": {
            "number": 3, "controls": ["elevator"], "learned": 0.625, "stop": "known to 10 %",
            "since_us": 1, "seconds": 7.5,
            "gauge": [{"derivative": "Cm_elevator", "value": -0.78, "sd_before": 0.4, "sd": 0.05,
                       "sd_wanted": 0.078}],
        },
        "maneuvers": [],
        "suggestions": [{"fly": "rudder doublets", "for": ["Cn_rhat", "CY_beta"], "wanted": 0.1}],
        "processes": {
            "phase": "known", "samples": 700, "wanted": 512,
            "coefficients": {"CZ": {"value": -0.4512, "sd": 0.004}},
        },
        "map": {
            "by": "processes", "level": 0.1, "least_s": 1.0,
            "speed": {"edges": [10.0, 15.0, 20.0], "seconds": [4.0, 8.0]},
            "planes": [
                {"x": "alpha", "y": "beta", "x_edges": [-0.1, 0.0, 0.1],
                 "y_edges": [-0.2, 0.0, 0.2],
                 "seconds": [[2.0, 0.0], [0.0, 3.0]],
                 "share_of_spread": {"Cm": [[0.05, 0.5], [0.5, 0.3]], "CZ": [[0.5] * 2] * 2}},
            ],
        },
        "latency": {"packet_to_update": {"p50_ms": 3.0, "p99_ms": 9.0}},
        "counts": {
            "received": 7, "recorded": 7, "updates": 5, "decimated": 0, "late": 0, "frozen": 4,
            "restarts": 0, "reboots": 1, "failures": 0, "lost": {"bad_crc": 2},
        },
        **parts,
    }  # fmt: skip


def write(folder: Path, document: dict) -> None:
    temporary = folder / ".live"
    temporary.write_text(json.dumps(document))
    temporary.replace(folder / "live.json")


@dataclass
class Page:
    """A served folder."""

    folder: Path
    address: server.Address

    def ask(self, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.address.port, timeout=PATIENCE_S)
        try:
            connection.request("GET", path, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()


def served(folder: Path, address: server.Address) -> Iterator[Page]:
    stop = threading.Event()
    thread = threading.Thread(
        target=server.serve, args=(folder, address), kwargs={"still": lambda: not stop.is_set()}
    )
    thread.start()
    page = Page(folder, address)
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        try:
            page.ask("/page.css")
            break
        except OSError:
            time.sleep(0.05)
    yield page
    stop.set()
    thread.join(PATIENCE_S)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    folder = tmp_path_factory.mktemp("live")
    write(folder, live())
    yield from served(folder, server.bind(port=0))


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Page]:
    write(tmp_path, live())
    opened = server.bind("0.0.0.0", 0)
    yield from served(tmp_path, opened)


def test_the_document_is_served_as_it_is_and_as_it_changes(page: Page) -> None:
    document = live()
    write(page.folder, document)
    connection = http.client.HTTPConnection("127.0.0.1", page.address.port, timeout=PATIENCE_S)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    assert answer.getheader("Content-Type") == "text/event-stream"
    for _ in range(3):
        while True:
            line = answer.readline()
            if line.startswith(b"data:"):
                seen = json.loads(line[5:])["document"]
                if seen == document:
                    break
        document = live(phase=f"flying {document['written_us']}")
        write(page.folder, document)
    connection.close()
    _, _, history = page.ask("/history.json")
    assert json.loads(history)[-1]["V"] == [21.34, 0.5]


def test_only_its_own_names_are_served(page: Page) -> None:
    (page.folder / "secret.txt").write_text("secret")
    for path in ("/secret.txt", "/../secret.txt", "/%2e%2e/secret.txt", "/assets/page.js", "//"):
        status, _, body = page.ask(path)
        assert status == 404, path
        assert b"secret" not in body


def test_nothing_comes_from_elsewhere_and_nothing_runs_but_its_own(page: Page) -> None:
    status, headers, body = page.ask("/")
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    text = (body + page.ask("/page.css")[2]).decode()
    for name in ("page", "learning", "start"):
        text += page.ask(f"/{name}.js")[2].decode()
    assert not re.search(r"https?://|innerHTML|eval\(", text)


def test_pages_from_elsewhere_are_not_answered(page: Page) -> None:
    """Neither under another name of this computer, nor from another page in the same browser."""
    assert page.ask("/live.json", Host="evil.example")[0] == 403
    assert page.ask("/live.json", **{"Sec-Fetch-Site": "cross-site"})[0] == 403
    status, headers, _ = page.ask("/live.json", Origin="http://evil.example")
    assert status == 200
    assert not [name for name in headers if name.lower().startswith("access-control")]


def test_beyond_this_computer_a_token_is_asked_for(guarded: Page) -> None:
    token = guarded.address.token
    assert len(token) >= 32
    assert guarded.ask("/live.json")[0] == 403
    assert guarded.ask("/live.json?token=wrong")[0] == 403
    status, headers, _ = guarded.ask(f"/?token={token}")
    assert status == 303
    assert headers["location"] == "/"
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "samesite=strict" in cookie.lower()
    status, _, body = guarded.ask("/live.json", Cookie=f"{COOKIE}={token}")
    assert status == 200
    assert json.loads(body)["aircraft"] == live()["aircraft"]


def test_many_pages_do_not_harm(page: Page) -> None:
    held = []
    for _ in range(MOST_CLIENTS + 4):
        connection = http.client.HTTPConnection("127.0.0.1", page.address.port, timeout=PATIENCE_S)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        if answer.status == 200:
            answer.readline()
        held.append((connection, answer.status))
    assert [status for _, status in held].count(503) >= 4
    assert page.ask("/live.json")[0] == 200
    for connection, _ in held:
        connection.close()


def test_a_port_that_is_taken_makes_room_for_the_next() -> None:
    first = server.bind(port=0)
    first.socket.listen()
    second = server.bind(port=first.port)
    assert second.port > first.port
    assert first.token == ""
    first.socket.close()
    second.socket.close()
    with pytest.raises(InputError, match="cannot be served"):
        server.bind("192.0.2.1", 1)


def test_files_that_are_no_live_documents_are_passed_over(tmp_path: Path) -> None:
    watch = Watch(tmp_path)
    for text in ("", "{", "[]", '{"command": "identify"}'):
        (tmp_path / "live.json").write_text(text)
        assert not watch.look()
    for _ in range(3):
        write(tmp_path, live())
        assert watch.look()
        assert not watch.look()
    assert watch.version == len(watch.history) == 3
    assert watch.history.maxlen == KEPT


def test_old_coefficients_make_a_gap_in_their_history() -> None:
    old = point(live(coefficients={"CZ": {"value": -0.4, "sd": 0.1, "age_s": 4.0}}))
    assert "CZ" not in old
    assert point(live())["CZ"] == [-0.4567, 0.01]


def test_a_point_has_no_number_that_is_none() -> None:
    told = point(live(coefficients={"CZ": {"value": float("nan"), "sd": 1.0}}))
    assert told["CZ"] == [None, 1.0]
    assert told["alpha"] == [0.1, 0.01]


def css_colours(theme: str) -> dict[str, str]:
    """The page's colours, `#rrggbb`, those of the dark page over those of the light one."""
    text = (ASSETS / "page.css").read_text()
    blocks = re.findall(r":root(\.dark)? {(.*?)}", text, re.DOTALL)
    names = {}
    for dark, block in blocks:
        if not dark or theme == "dark":
            names |= dict(re.findall(r"--([a-z-]+): (#[0-9a-f]+);", block))
    return {
        name: c if len(c) == 7 else "#" + "".join(2 * x for x in c[1:]) for name, c in names.items()
    }


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_text_can_be_read_in_the_sun_and_at_night(theme: str) -> None:
    """WCAG 2.2: 7 for what is read most, 4.5 for all text, 3 for edges and areas."""
    page = css_colours(theme)
    for ground in ("paper", "box"):
        assert contrast(page["ink"], page[ground]) >= 7.0, ground
        for name in ("quiet", "mark", "alarm", "go"):
            assert contrast(page[name], page[ground]) >= 4.5, (name, ground)
    assert contrast(page["on-alarm"], page["alarm"]) >= 4.5
    assert contrast(page["paper"], page["mark"]) >= 4.5
    for name in ("line", "amber"):
        assert contrast(page[name], page["paper"]) >= 3.0, name


def _shows_the_document(browser: Browser, folder: Path) -> None:
    browser.until("document.querySelectorAll('.tile').length === 2")
    browser.until("document.body.className === 'stale'")
    seen = browser.evaluate("document.documentElement.outerHTML")
    assert 'data-name="V"><span>airspeed</span><b>21.3</b><span>± 1.0 m/s</span>' in seen
    assert "<b>5.7</b><span>± 1.1 °</span>" in seen  # 0.1 rad ± 1.96 · 0.01 rad
    assert "-0.457 ± 0.020" in seen
    assert "-0.4512 ± 0.0078" in seen
    assert "by the processes" in seen
    assert "alpha -4.50 ± 0.49" in seen
    assert "derivatives: inside the filter" in seen
    words = "Aerodynamics inside the filter: airspeed, flow angles and derivatives shown here are"
    assert f"{words} its own; begun anew 1 times. Last: gusts that last &lt;0.3 s&gt;." in seen
    assert html.escape("A <b>bold</b> aircraft") in seen
    assert "The vehicle refuses AOA_SSA." in seen
    assert "VFR_HUD repeats itself for 4 s and is left out." in seen
    # −0.346 ± 1.96 · 0.02, in percent; a shift in mean chords.
    assert "effect of the &lt;i&gt;elevator&lt;/i&gt;: -34.6 ± 3.9 % (&gt; 99.9 %)" in seen
    assert "centre of gravity: -0.0622 ± 0.0078 mean chords forward (2 %)" in seen
    assert "Maneuver 3: elevator, 8 s" in seen
    assert "STOP: known to 10 %" in seen
    assert "62 % learned by the first model" in seen or "63 % learned by the first model" in seen
    assert "rudder doublets — for Cn_rhat, CY_beta" in seen
    assert browser.evaluate("document.querySelectorAll('#map canvas').length") == 2
    pressed = "document.querySelector('#chooser [aria-pressed=true]').textContent"
    assert browser.evaluate(pressed) == "Cm"
    # Flown and known, flown and not known, never flown: three fills of the first map.
    fill = (
        "(([x, y]) => {{ const c = document.querySelector('#map canvas');"
        " const k = c.width / c.clientWidth; return Array.from(c.getContext('2d')"
        ".getImageData(k * x, k * y, 1, 1).data).join(); }})([{}, {}])"
    )
    width_, height_ = (
        browser.evaluate(f"document.querySelector('#map canvas').client{side}")
        for side in ("Width", "Height")
    )
    left, right = 44 + 0.1 * (width_ - 50), 44 + 0.6 * (width_ - 50)
    top, bottom = 8 + 0.1 * (height_ - 34), 8 + 0.6 * (height_ - 34)
    known, never = fill.format(left, bottom), fill.format(left, top)
    visited = fill.format(right, top)
    colours = [browser.evaluate(one) for one in (known, visited, never)]
    assert len(set(colours)) == 3, colours
    assert "CZ: the simulation has departed for 12 s (4.2 standard deviations)." in seen
    words = "Cm by &lt;q&gt;: the simulation has departed for 3 s (5.0 standard deviations)."
    assert words in seen
    age = re.search(r"Values are (\d+) s old\.", seen)
    # 42 s when they were written, and older by what a slow machine takes to open the browser.
    assert age is not None
    assert 42 <= int(age[1]) < 42 + browsers.PATIENCE_S
    assert "0 late, 4 frozen, 0 restarts, 1 reboots, 0 failures, lost: bad_crc 2" in seen
    sides = "[b.getBoundingClientRect().width, b.getBoundingClientRect().height]"
    buttons = f"Array.from(document.querySelectorAll('button')).map(b => Math.min(...{sides}))"
    smallest = browser.evaluate(f"Math.min(...{buttons})")
    assert smallest >= 44.0, "too small for a thumb"
    across = "document.documentElement.scrollWidth - window.innerWidth"
    assert browser.evaluate(across) <= 0, "wider than the screen"
    # What a model knows must not lie beside the page, where nobody looks for it.
    beside = "document.querySelector('#model').scrollWidth - window.innerWidth"
    assert browser.evaluate(beside) <= 0, "derivatives beside the page"
    assert browser.evaluate("document.querySelector('#model .old') === null")
    write(folder, live(coefficients={"CZ": {"value": -0.4567, "sd": 0.01, "age_s": 7.2}}))
    quiet = "!document.getElementById('alarm').textContent.includes('old')"
    browser.until(f"document.body.className === '' && {quiet}")
    struck = "Array.from(document.querySelectorAll('#model .old')).map(e => e.textContent).join()"
    assert browser.evaluate(struck) == "-0.457 ± 0.020,-0.4512 ± 0.0078"
    aged = browser.evaluate("document.querySelector('#model .age').textContent")
    words = re.fullmatch(r" (\d+) s old", aged)
    assert words is not None
    assert 7 <= int(words[1]) < 7 + browsers.PATIENCE_S
    browser.evaluate("document.getElementById('theme').click()")
    assert browser.evaluate("document.documentElement.className") == "dark"


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
@pytest.mark.parametrize("width", [1280, 400], ids=["screen", "phone"])
def test_what_the_browser_shows_is_the_document(page: Page, tmp_path: Path, width: int) -> None:
    """Values, intervals, alarms, and a name with markup in it that stays text."""
    write(page.folder, live(state_age_s=42.0))
    with closing(Browser(page.address.url, tmp_path, width=width)) as browser:
        _shows_the_document(browser, page.folder)


@pytest.mark.parametrize("how", ["exit 1", "exec sleep 60"], ids=["ends", "hangs"])
def test_a_browser_that_does_not_work_fails_its_tests(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that is there and broken must not pass for one that is not there."""
    broken = tmp_path / "chromium"
    broken.write_text(f"#!/bin/sh\n{how}\n")
    broken.chmod(0o755)
    monkeypatch.setattr(browsers, "CHROMIUM", str(broken))
    monkeypatch.setattr(browsers, "PATIENCE_S", 1.0)
    with pytest.raises((AssertionError, BrokenPipeError)):
        Browser("about:blank", tmp_path / "profile")


def test_pages_that_follow_are_let_go_without_a_word(tmp_path: Path) -> None:
    """uvicorn told users that it cancelled a running task whenever `listen` ended."""
    write(tmp_path, live())
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs_sysid", "dashboard", str(tmp_path), "--port", "0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    port = int(process.stdout.readline().rstrip("/\n").rpartition(":")[2])
    until = time.monotonic() + PATIENCE_S
    while True:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
        try:
            connection.request("GET", "/events")
            break
        except OSError:
            assert time.monotonic() < until
            time.sleep(0.05)
    connection.getresponse().readline()
    process.terminate()
    out, err = process.communicate(timeout=PATIENCE_S)
    connection.close()
    assert out == err == ""


def test_a_terminal_shows_the_folder_until_the_flight_has_ended(tmp_path: Path) -> None:
    names = ("alpha", "beta", "wind_north", "wind_east", "wind_down")
    state = {name: {"value": 0.1, "sd": 0.01, "unit": ""} for name in names}
    state["V"] = {"value": 21.34, "sd": 0.5, "unit": "m/s"}
    write(tmp_path, live(state=state))
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs_sysid", "dashboard", str(tmp_path), "--terminal"],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().startswith("flying | airspeed 21.3")
    write(tmp_path, live(phase="ended: quiet", state=state))
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert out.startswith("ended: quiet | airspeed 21.3")
    assert process.returncode == 0
