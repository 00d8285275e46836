"""Options of `companion lidar` that are wrong, or do not go together."""

from __future__ import annotations

import pytest

from companion import cli


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (["--model", "ld19", "--lidar", "udpin://127.0.0.1:56301", "--check"], "a ld19 is read at serial://"),
        (["--model", "mid360", "--lidar", "serial:///dev/ttyS0:9600", "--check"], "a mid360 is read at udpin://"),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600"], "--id and --to are needed"),
        (
            ["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--raw", "multi-layer"],
            "--raw multi-layer: a mid360 is multi-layer, and no other is",
        ),
        (
            ["--model", "mid360", "--lidar", "udpin://127.0.0.1:56301", "--check", "--raw", "scan-1deg"],
            "--raw scan-1deg: a mid360 is multi-layer, and no other is",
        ),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--id", "251"], "--id 251: must be"),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--component", "1"], "--component 1"),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--yaw-deg", "nan"], "--yaw-deg nan"),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--range-m", "13"], "at most 12"),
        (["--model", "ld19", "--lidar", "serial:///dev/ttyS0:9600", "--check", "--configure", "1"], "is for a mid360"),
        (
            ["--model", "mid360", "--lidar", "udpin://0.0.0.0:1", "--check", "--configure", "1.2.3.4"],
            "own IPv4 address",
        ),
        *(
            (
                ["--model", "mid360", "--lidar", "udpin://127.0.0.1:56301", "--check", "--configure", address],
                f"--configure {address}: must be the lidar's ADDRESS[:PORT]",
            )
            for address in ("192.168.1", "192.168.1.300", "192.168.1.112:0", "lidar.local", "1.2.3.4:5:6", "0.0.0.0")
        ),
        *(
            (
                ["--model", model, "--lidar", "serial:///dev/ttyS0:9600", "--check", "--band-m=0.2..0.6"],
                f"--band-m: is for a mid360; a {model} measures in one plane",
            )
            for model in ("ld06", "ld19", "rplidar-a")
        ),
        *(
            (
                ["--model", model, "--lidar", "serial:///dev/ttyS0:9600", "--check", "--raw", "scan-0.5deg"],
                f"--raw scan-0.5deg: an {model} is scan-1deg, of 450 rays a turn, not 720",
            )
            for model in ("ld06", "ld19")
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    options: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["lidar", *options]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value"), [("--mask", "10"), ("--band-m", "1..0"), ("--lidar", "udpout://127.0.0.1:1")]
)
def test_a_wrong_value_is_named(option: str, value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["lidar", "--model", "ld19", "--check", "--lidar", "serial:///dev/ttyS0:9600", option, value])
    assert ended.value.code == 2
    assert value in capsys.readouterr().err
