"""Chromium, driven by chromedriver over plain HTTP (W3C WebDriver): both from Debian's packages, and no library."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import urllib.request
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium")
DRIVER = shutil.which("chromedriver")
WHY_NOT = None if CHROMIUM and DRIVER else "no Chromium here: apt-get install chromium chromium-driver"
AXE = Path(__file__).parents[2] / "sim_bridge/judge/page/web/node_modules/axe-core/axe.min.js"
WHY_NOT_AXE = None if AXE.exists() else "no axe-core here: make page-check installs it (npm)"
AXE_RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa")
WAIT_S = 120.0  # of wall time, for an answer: a browser on a busy machine
END_S = 10.0  # of wall time, for the driver to end
ARGUMENTS = (
    "--headless=new",
    "--no-sandbox",  # as root in a container there is none
    "--disable-dev-shm-usage",
    "--use-angle=swiftshader",  # WebGL by the processor
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--force-device-scale-factor=1",
    "--no-first-run",
    "--disable-background-networking",
)
# As it runs without a graphics processor: canvases are drawn by the processor, fast enough for what never rests
SOFTWARE = tuple(argument for argument in ARGUMENTS if "angle" not in argument)


class Browser:
    """One headless Chromium. Use as a context manager."""

    def __init__(
        self, width: int = 1280, height: int = 800, *, offline: bool = True, arguments: tuple[str, ...] = ARGUMENTS
    ) -> None:
        """`offline`: without a network, loopback among it; `arguments`: of Chromium."""
        assert CHROMIUM is not None, WHY_NOT
        assert DRIVER is not None, WHY_NOT
        self._driver = subprocess.Popen(
            [DRIVER, "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self._base = f"http://127.0.0.1:{self._port()}"
        options = {"binary": CHROMIUM, "args": [*arguments, f"--window-size={width},{height}"]}
        wanted = {
            "browserName": "chrome",
            "goog:chromeOptions": options,
            "goog:loggingPrefs": {"browser": "ALL", "performance": "ALL"},
        }
        self._session = ""
        try:
            made = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
            self._session = f"/session/{made['sessionId']}"
            self.cdp("Network.enable")
            network = {"offline": offline, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
            self.cdp("Network.emulateNetworkConditions", **network)
            self.screen(width, height)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End both programs."""
        try:
            if self._session:
                self._call("DELETE", self._session)
        finally:
            self._driver.terminate()
            try:
                self._driver.communicate(timeout=END_S)
            except subprocess.TimeoutExpired:  # it has been seen to wait for ever
                self._driver.kill()
                self._driver.communicate()

    def screen(self, width: int, height: int, *, mobile: bool = False) -> None:
        """The size of the page's window, px."""
        self.cdp("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        self.cdp("Emulation.setTouchEmulationEnabled", enabled=mobile)

    def dark(self, dark: bool) -> None:
        """What the page is told that its reader prefers."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.cdp("Emulation.setEmulatedMedia", features=[scheme])

    def open(self, file: Path | str, fragment: str = "", *, scripted: bool = True) -> None:
        """Load a page from disk, or from an address, and wait until it is drawn; not `scripted`: it has no script."""
        url = file if isinstance(file, str) else file.resolve().as_uri()
        self._call("POST", f"{self._session}/url", {"url": "about:blank"})
        self._call("POST", f"{self._session}/url", {"url": url + fragment})
        self.wait(
            "document.documentElement.dataset.ready !== undefined" if scripted else "document.readyState === 'complete'"
        )

    def frame(self, number: int) -> None:
        """Look into the page's frame of that number, from 0: `wait` and `run` are in there from now on."""
        self._call("POST", f"{self._session}/frame", {"id": number})

    def out_of_frame(self) -> None:
        """Look at the page itself again."""
        self._call("POST", f"{self._session}/frame", {"id": None})

    def wait(self, condition: str) -> None:
        """Until a JavaScript expression is true. TimeoutError, a WebDriver error, after WAIT_S."""
        script = (
            "const done = arguments[0]; const look = () => "
            f"{{ if ({condition}) done(true); else requestAnimationFrame(look); }}; look();"
        )
        self._call("POST", f"{self._session}/timeouts", {"script": int(1000 * WAIT_S)})
        self._call("POST", f"{self._session}/execute/async", {"script": script, "args": []})

    def asked(self, script: str, *arguments: Any) -> Any:
        """What a JavaScript function body hands to the function that is its last argument, within WAIT_S."""
        self._call("POST", f"{self._session}/timeouts", {"script": int(1000 * WAIT_S)})
        return self._call("POST", f"{self._session}/execute/async", {"script": script, "args": list(arguments)})

    def run(self, script: str, *arguments: Any) -> Any:
        """What a JavaScript function body returns."""
        return self._call("POST", f"{self._session}/execute/sync", {"script": script, "args": list(arguments)})

    def barriers(self) -> list[str]:
        """What axe finds on the page against WCAG 2.2, A and AA: its rule, what it says of it, and where."""
        self.run(AXE.read_text(encoding="utf-8"))
        found = self.run(
            "return axe.run({runOnly: arguments[0]}).then(({violations, passes}) => [passes.length,"
            " violations.flatMap(({id, help, nodes}) => nodes.map(({target}) => `${id}: ${help}: ${target}`))])",
            AXE_RULES,
        )
        passed, barriers = found
        assert passed > 0, "axe looked at nothing"
        return [str(barrier) for barrier in barriers]

    def key(self, key: str, code: str = "") -> None:
        """Press and release a key."""
        for kind in ("rawKeyDown", "keyUp"):
            self.cdp("Input.dispatchKeyEvent", type=kind, key=key, code=code or key, windowsVirtualKeyCode=0)

    def cdp(self, command: str, **parameters: Any) -> Any:
        """A command of the DevTools protocol."""
        return self._call("POST", f"{self._session}/goog/cdp/execute", {"cmd": command, "params": parameters})

    def screenshot(self) -> bytes:
        """Of the window, PNG."""
        return base64.b64decode(self._call("GET", f"{self._session}/screenshot"))

    def console(self) -> list[str]:
        """What the page wrote to the console since it was asked last, errors among it."""
        return [f"{entry['level']}: {entry['message']}" for entry in self._log("browser")]

    def requests(self) -> list[str]:
        """What was asked for since this was asked last, by address, but for the page's own file and data in it."""
        found = []
        for entry in self._log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                found.append(message["params"]["request"]["url"])
        return [url for url in found if not url.startswith(("file:", "data:", "blob:", "about:"))]

    def _log(self, kind: str) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = self._call("POST", f"{self._session}/se/log", {"type": kind})
        return found

    def _port(self) -> int:
        assert self._driver.stdout is not None
        for line in self._driver.stdout:
            if found := re.search(r"started successfully on port (\d+)", line):
                return int(found[1])
        raise OSError(f"{DRIVER} has ended: {self._driver.wait()}")

    def _call(self, method: str, path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self._base + path, data, {"Content-Type": "application/json"}, method=method)
        try:
            with urllib.request.urlopen(request, timeout=2 * WAIT_S) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise OSError(f"{path}: {error.read().decode()[:600]}") from None
