"""Debian trees to install in: entered without a network, in the emulated processor too, or booted with systemd."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

SUITE = "bookworm"
MIRROR = "http://deb.debian.org/debian"
PACKAGES = {"amd64": "python3,systemd,systemd-sysv,dbus", "arm64": "python3"}
TOOLS = {
    "debootstrap": "debootstrap",
    "systemd-nspawn": "systemd-container",
    "qemu-aarch64-static": "qemu-user-static",
    "unshare": "util-linux",
}
BINFMT = Path("/proc/sys/fs/binfmt_misc")
AARCH64_ELF = (
    r":understory-aarch64:M::\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00"
    r":\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff:{}:OCF"
)
BOOT_LIMIT_S = 60.0
# $1: the tree, $2: a folder that it shares with this computer at the same path. The mounts end with the process.
ENTER = """\
root=$1 shared=$2; shift 2
mount --rbind /dev "$root/dev" && mount -t proc proc "$root/proc"
if [ -n "$shared" ]; then mkdir -p "$root$shared" && mount --bind "$shared" "$root$shared"; fi
exec chroot "$root" /usr/bin/env -u PYTHONPATH -u PYTHONHOME LC_ALL=C.UTF-8 \\
    PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"
"""


def tools() -> None:
    """Install what is missing of Debian's packages."""
    missing = sorted({package for tool, package in TOOLS.items() if shutil.which(tool) is None})
    if missing:
        subprocess.run(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *missing], check=True)


@contextmanager
def emulation() -> Iterator[None]:
    """The kernel hands arm64 programs to qemu, as Debian's qemu-user-static arranges where systemd runs."""
    mounted = not (BINFMT / "register").exists()
    if mounted:
        subprocess.run(["mount", "-t", "binfmt_misc", "binfmt_misc", str(BINFMT)], check=True)
    there = any((BINFMT / name).exists() for name in ("qemu-aarch64", "understory-aarch64"))
    try:
        if not there:
            (BINFMT / "register").write_text(AARCH64_ELF.format(shutil.which("qemu-aarch64-static")))
        yield
    finally:
        if not there:
            (BINFMT / "understory-aarch64").write_text("-1")
        if mounted:
            subprocess.run(["umount", str(BINFMT)], check=True)


class Userland:
    """A Debian tree of its own, removed at the end of `fresh`."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def command(self, *command: str, shared: Path | None = None) -> list[str]:
        """To run in the tree, with this computer's network."""
        return ["unshare", "--mount", "sh", "-ec", ENTER, "sh", str(self.root), str(shared or ""), *command]

    def offline(self, *command: str) -> str:
        """Run in the tree, in a network namespace with nothing in it; what it said. CalledProcessError."""
        return run(["unshare", "--net", *self.command(*command)])

    def unpack(self, bundle: Path) -> str:
        """The bundle's folder in the tree."""
        shutil.unpack_archive(bundle, self.root / "root", filter="tar")
        return f"/root/{bundle.name.removesuffix('.tar.gz')}"


def run(command: Sequence[str]) -> str:
    """Its output; CalledProcessError with it."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode:
        raise subprocess.CalledProcessError(done.returncode, list(command), done.stdout)
    return done.stdout


@contextmanager
def fresh(arch: str, cache: Path) -> Iterator[Userland]:
    """A clean tree of `arch`; debootstrap makes it once, and a copy of it is used."""
    made = cache / f"debian-{SUITE}-{arch}"
    if not made.is_dir():
        print(f"making a minimal Debian {SUITE} for {arch}: minutes, once", flush=True)
        partial = made.with_suffix(".partial")
        shutil.rmtree(partial, ignore_errors=True)
        foreign = ["--foreign"] if arch == "arm64" else []
        include = f"--include={PACKAGES[arch]}"
        run(["debootstrap", "--variant=minbase", f"--arch={arch}", *foreign, include, SUITE, str(partial), MIRROR])
        if foreign:
            run(["chroot", str(partial), "/debootstrap/debootstrap", "--second-stage"])
        partial.rename(made)
    copy = cache / f"run-{arch}-{os.getpid()}"
    run(["cp", "-a", "--reflink=auto", str(made), str(copy)])
    try:
        yield Userland(copy)
    finally:
        shutil.rmtree(copy)


class Booted:
    """A tree with its own systemd, on this computer's network."""

    def __init__(self, userland: Userland, log: Path) -> None:
        with log.open("wb") as output:
            self._nspawn = subprocess.Popen(
                [
                    *("systemd-nspawn", f"--directory={userland.root}", "--boot", "--register=no", "--keep-unit"),
                    *("--console=pipe", "--machine=understory-board-test"),
                ],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        self._init = 0
        end_s = time.monotonic() + BOOT_LIMIT_S
        while time.monotonic() < end_s and self._nspawn.poll() is None:
            children = Path(f"/proc/{self._nspawn.pid}/task/{self._nspawn.pid}/children").read_text().split()
            if children:
                self._init = int(children[0])
                if self.ask("systemctl", "is-system-running").strip() in ("running", "degraded"):
                    return
            time.sleep(0.2)
        self.close()
        raise TimeoutError(f"systemd does not come up: {log}")

    def command(self, *command: str, network: bool = True) -> list[str]:
        """To run beside the booted system's services."""
        enter = ["nsenter", f"--target={self._init}", "--mount", "--uts", "--ipc", "--pid"]
        return [*enter, *([] if network else ["unshare", "--net"]), *command]

    def run(self, *command: str, network: bool = True) -> str:
        """Its output. CalledProcessError."""
        return run(self.command(*command, network=network))

    def ask(self, *command: str) -> str:
        """Its output, whatever its exit code."""
        return subprocess.run(self.command(*command), capture_output=True, text=True, check=False).stdout

    def shown(self, name: str) -> str:
        """A property of the service."""
        return self.run("systemctl", "show", f"--property={name}", "--value", "understory-companion").strip()

    def close(self) -> None:
        """Power off."""
        if self._init:
            subprocess.run(self.command("systemctl", "poweroff"), capture_output=True, check=False)
        try:
            self._nspawn.wait(15.0)
        except subprocess.TimeoutExpired:
            os.kill(self._nspawn.pid, 15)
            self._nspawn.wait(15.0)
