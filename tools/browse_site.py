"""Reads the built site as a visitor would, in Chromium without a screen, on a telephone.

    tools/get_browser.sh
    /usr/bin/python3 tools/browse_site.py site

Asks of every page: no link, picture or script is dead; nothing is fetched from elsewhere; every formula is set and
none has an error; nothing but what scrolls by itself (tables, code, formulas) is wider than a telephone's 360 points;
films play. Of the search: it finds `craig_bampton`. Prints what is wrong, page by page. Needs
Debian's Chromium and its python3-selenium, nothing of flexmbd.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import re
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urldefrag, urljoin

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

WIDTH, HEIGHT = 360, 740
PATIENCE = 20.0  # s, for formulas, films and the search

#: Once all formulas of a page are set: what it holds.
LOOK = """
const done = arguments[arguments.length - 1];
const ready = window.MathJax && MathJax.startup ? MathJax.startup.promise : Promise.resolve();
ready.then(() => {
  const text = e => (e.textContent || '').trim().slice(0, 60);
  const all = s => Array.from(document.querySelectorAll(s));
  const scrolls = e => e && e.tagName !== 'ARTICLE'
      && (['auto', 'scroll'].includes(getComputedStyle(e).overflowX) || scrolls(e.parentElement));
  const wide = all('article *:not(mjx-assistive-mml, mjx-assistive-mml *)').filter(
      e => e.getBoundingClientRect().right > WIDTH + 1 && !scrolls(e.parentElement) && !scrolls(e)).slice(0, 1);
  done({
    wide: wide.map(e => e.tagName + ' ' + text(e)),
    formulas: all('.math').length,
    unset: all('.math').filter(e => !e.querySelector('mjx-container')).map(text),
    faulty: all('mjx-merror, [data-mml-node="merror"]').map(text),
    ids: all('[id], a[name]').map(e => e.id || e.name),
    links: all('a[href]').map(e => e.href),
    pictures: all('img').filter(e => e.complete && !e.naturalWidth).map(e => e.src),
    films: all('video').length,
    fetched: performance.getEntriesByType('resource').map(e => e.name),
  });
});
""".replace("WIDTH", str(WIDTH))

#: Plays every film of a page: its length in s, and whether it moved; null where it does not load.
PLAY = """
const done = arguments[arguments.length - 1];
Promise.all(Array.from(document.querySelectorAll('video')).map(film => new Promise(resolve => {
  const stop = setTimeout(() => resolve([film.currentSrc, null, 0]), 15000);
  film.addEventListener('timeupdate', () => {
    if (film.currentTime > 0.05) { clearTimeout(stop); resolve([film.currentSrc, film.duration, film.videoWidth]); }
  });
  film.muted = true;
  film.play().catch(() => {});
}))).then(done);
"""


@dataclass(frozen=True)
class Seen:
    """What a page holds, as LOOK tells, and what the browser complained of."""

    found: dict[str, Any]
    complaints: list[str]
    films: list[list[Any]]


def main() -> int:
    """Visit all pages; 0 where nothing is wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path, help="the folder that ./run docs built")
    parser.add_argument("--films", type=int, default=0, metavar="N", help="the least number of films that must play")
    asked = parser.parse_args()
    pages = sorted(page.relative_to(asked.site).as_posix() for page in asked.site.rglob("*.html"))
    if not pages:
        parser.error(f"no page in {asked.site}")
    with _served(asked.site) as root, _browser() as browser:
        seen = {urljoin(root, page): _visit(browser, urljoin(root, page)) for page in pages}
        faults = [*_faults(seen, root, asked.site), *_search_faults(browser, root)]
    films = sum(len(one.films) for one in seen.values())
    if films < asked.films:
        faults.append(f"{films} films, where {asked.films} were expected")
    print("\n".join(faults))
    formulas = sum(one.found["formulas"] for one in seen.values())
    links = sum(len(one.found["links"]) for one in seen.values())
    print(f"{len(pages)} pages, {links} links, {formulas} formulas, {films} films: {len(faults)} faults")
    return 1 if faults else 0


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of each request."""


@contextlib.contextmanager
def _served(folder: Path) -> Iterator[str]:
    """The address of a folder, served on this machine alone."""
    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@contextlib.contextmanager
def _browser() -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for word in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--mute-audio"):
        options.add_argument(word)
    metrics = {"width": WIDTH, "height": HEIGHT, "pixelRatio": 2.0}
    options.add_experimental_option("mobileEmulation", {"deviceMetrics": metrics})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(service=Service("/usr/bin/chromedriver"), options=options)
    browser.set_script_timeout(PATIENCE)
    try:
        yield browser
    finally:
        browser.quit()


def _visit(browser: Any, address: str) -> Seen:
    browser.get(address)
    found = browser.execute_async_script(LOOK)
    films = browser.execute_async_script(PLAY) if found["films"] else []
    said = [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
    complaints = [one for one in said if "favicon.ico" not in one]
    return Seen(found, complaints, films)


def _faults(seen: dict[str, Seen], root: str, site: Path) -> Iterator[str]:
    for address, page in seen.items():
        name, found = address.removeprefix(root), page.found
        yield from (f"{name}: {complaint}" for complaint in page.complaints)
        # the theme hides or scrolls what is too wide for the page, so that its own width tells nothing
        yield from (f"{name}: wider than a telephone of {WIDTH} points: {text}" for text in found["wide"])
        yield from (f"{name}: a formula is not set: {text}" for text in found["unset"])
        yield from (f"{name}: a formula is wrong: {text}" for text in found["faulty"])
        yield from (f"{name}: no picture: {picture}" for picture in found["pictures"])
        yield from (f"{name}: fetched from elsewhere: {one}" for one in found["fetched"] if not one.startswith(root))
        for film, length, width in page.films:
            if not (length and width):
                yield f"{name}: {film} does not play"
        for link in sorted(set(found["links"])):
            if link.startswith(root) and not _leads_somewhere(link, seen, root, site):
                yield f"{name}: dead link {link.removeprefix(root)}"


def _leads_somewhere(link: str, seen: dict[str, Seen], root: str, site: Path) -> bool:
    path, place = urldefrag(link)
    path = path.partition("?")[0]
    if path.endswith("/"):
        path += "index.html"
    if path in seen:
        return not place or unquote(place) in seen[path].found["ids"]
    return (site / unquote(path.removeprefix(root))).is_file()


def _search_faults(browser: Any, root: str) -> Iterator[str]:
    browser.get(urljoin(root, "search.html?q=craig_bampton"))
    ends = time.monotonic() + PATIENCE
    found: list[str] = []
    while time.monotonic() < ends and not found:
        time.sleep(0.2)
        script = "return Array.from(document.querySelectorAll('#search-results li a')).map(e => e.href)"
        found = browser.execute_script(script)
    if not any(re.search(r"reference/reduction\.html", address) for address in found):
        yield f"search.html: craig_bampton leads to {found or 'nothing'}, not to its reference"


if __name__ == "__main__":
    sys.exit(main())
