"""The report in headless Chromium: no complaint, no request, everything has a size."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
PROBE = """<script>
const size = e => [e.getBoundingClientRect().width, e.getBoundingClientRect().height];
addEventListener("load", () => {
  const seen = {
    images: [...document.images].map(i => [i.naturalWidth, ...size(i)]),
    rows: document.querySelectorAll("table.verdicts tbody tr").length,
    math: [...document.querySelectorAll(".equation math")].map(size),
    requests: performance.getEntriesByType("resource").map(r => r.name).filter(n => !n.startsWith("data:")),
    wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  };
  const out = document.createElement("pre");
  out.id = "probe";
  out.textContent = "PROBE" + JSON.stringify(seen) + "END";
  document.body.append(out);
});
</script>"""


def chromium(tmp_path: Path, page: Path, *options: str) -> subprocess.CompletedProcess[str]:
    assert CHROMIUM is not None
    arguments = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--log-net-log={tmp_path / 'net.json'}",
        f"--user-data-dir={tmp_path / 'profile'}", *options, page.as_uri(),
    ]  # fmt: skip
    environment = {**os.environ, "HOME": str(tmp_path)}
    return subprocess.run(arguments, capture_output=True, text=True, timeout=120, check=False, env=environment)


def asked_by_page(tmp_path: Path) -> list[str]:
    """Return the web addresses that the page asked for, from the browser's log; its own errands have no origin."""
    events = [event.get("params", {}) for event in json.loads((tmp_path / "net.json").read_text())["events"]]
    asked = [event["url"] for event in events if event.get("initiator", "not an origin") != "not an origin"]
    return [url for url in asked if url.startswith(("http:", "https:"))]


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed (apt-get install chromium)")
class TestInChromium:
    def test_no_complaint_and_no_request(self, lag_folder: Path, tmp_path: Path) -> None:
        done = chromium(tmp_path, lag_folder / "report.html", "--dump-dom")
        assert "</html>" in done.stdout
        assert [line for line in done.stderr.splitlines() if "CONSOLE" in line] == []
        assert asked_by_page(tmp_path) == []

    def test_sizes_and_rows(self, lag_folder: Path, lag_report: Any, tmp_path: Path) -> None:
        text = (lag_folder / "report.html").read_text(encoding="utf-8")
        copy = tmp_path / "probed.html"
        start, end = text.index('<meta http-equiv="Content'), text.index('<meta name="viewport"')
        copy.write_text(text[:start] + text[end:].replace("</body>", f"{PROBE}</body>"), encoding="utf-8")
        dumped = chromium(tmp_path, copy, "--window-size=1200,900", "--dump-dom").stdout
        seen = json.loads(dumped.rpartition("PROBE")[2].partition("END")[0].replace("&gt;", ">").replace("&lt;", "<"))
        assert len(seen["images"]) == 1 + len(lag_report.campaign.figures())
        assert all(min(sizes) > 50 for sizes in seen["images"])
        assert seen["rows"] == len(lag_report.verdicts)
        assert len(seen["math"]) == 2 and all(min(sizes) > 5 for sizes in seen["math"])
        assert seen["requests"] == [] and seen["wide"] <= 0

    def test_complaints_and_requests_would_be_seen(self, lag_folder: Path, tmp_path: Path) -> None:
        text = (lag_folder / "report.html").read_text(encoding="utf-8")
        text = text.replace("</main>", '<img src="http://127.0.0.1:9/x.png"></main>')
        guarded, open_copy = tmp_path / "guarded.html", tmp_path / "open.html"
        guarded.write_text(text, encoding="utf-8")
        open_copy.write_text(text.replace("Content-Security-Policy", "nothing"), encoding="utf-8")
        lines = chromium(tmp_path, guarded, "--dump-dom").stderr.splitlines()
        assert any("CONSOLE" in line and "Content Security Policy" in line for line in lines)
        assert asked_by_page(tmp_path) == []
        chromium(tmp_path, open_copy, "--dump-dom")
        assert asked_by_page(tmp_path) == ["http://127.0.0.1:9/x.png"]

    def test_prints_on_pages(self, lag_folder: Path, tmp_path: Path) -> None:
        paper = tmp_path / "report.pdf"
        chromium(tmp_path, lag_folder / "report.html", f"--print-to-pdf={paper}", "--no-pdf-header-footer")
        content = paper.read_bytes()
        assert (
            content.startswith(b"%PDF") and 1 <= content.count(b"/Type /Page\n") + content.count(b"/Type /Page ") <= 12
        )
