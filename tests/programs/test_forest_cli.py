"""`mission forest`: make, import, check, draw."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

import mission
from mission.cli.main import main
from mission.document.load import load_mission
from mission.document.model import Origin
from mission.stand.stand import stand_of
from mission.stems.stem_map import read_stems

EXAMPLES = Path(mission.__file__).parent / "examples"
MANAGED, NATURAL, LONE_TREE = (
    str(EXAMPLES / f"{name}.toml") for name in ("managed_stand", "natural_stand", "lone_tree")
)
SVG = "{http://www.w3.org/2000/svg}"
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    file = tmp_path / "plot.csv"
    file.write_text(
        "Easting;Northing;BHD;Hoehe;Baumart;Nr\n500010,5;5205000;32,5;24,1;Fichte;1\n500020;5205010;;;Buche;2\n"
    )
    return file


def run(capsys: Captured, *argv: str) -> tuple[int, str, str]:
    code = main(["forest", *argv])
    out, err = capsys.readouterr()
    return code, out, err


# make


@pytest.mark.parametrize("suffix", ["csv", "geojson"])
def test_make_writes_the_stand_of_a_mission(suffix: str, tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / f"stems.{suffix}"
    code, said, _ = run(capsys, "make", "--mission", NATURAL, "--out", str(out), "--origin", "47", "8")

    stand = stand_of(load_mission(NATURAL))
    assert (code, said) == (0, f"{out}: {len(stand.trees)} trees and {len(stand.bushes)} bushes\n")
    stems = read_stems(out, origin=Origin(lat_deg=47, lon_deg=8, alt_m=0).wgs84)
    assert (stems.trees, stems.bushes) == (stand.trees, stand.bushes)


def test_make_takes_another_seed_and_other_keys(tmp_path: Path, capsys: Captured) -> None:
    files = [tmp_path / f"{k}.csv" for k in range(3)]
    for file, options in zip(files, ([], ["--seed", "2"], ["--seed", "2"]), strict=True):
        assert run(capsys, "make", "--mission", MANAGED, "--out", str(file), *options, "density_per_ha=50")[0] == 0

    first, second, third = (file.read_text() for file in files)
    assert first != second == third
    assert len(read_stems(files[0]).trees) == pytest.approx(110, abs=12)


def test_make_without_a_mission_grows_a_rectangle(tmp_path: Path, capsys: Captured) -> None:
    out = str(tmp_path / "stems.csv")
    code, _, _ = run(capsys, "make", "--out", out, "--area-m", "100", "50", "density_per_ha=600", "species=pine,spruce")

    trees = read_stems(out).trees
    assert code == 0
    assert len(trees) == pytest.approx(300, abs=2)
    assert {tree.species for tree in trees} == {"pine", "spruce"}
    assert 98.0 < max(tree.east_m for tree in trees) <= 100.0
    assert 48.0 < max(tree.north_m for tree in trees) <= 50.0


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["density_per_ha=0"], "KEY=VALUE: forest.stand.density_per_ha = 0: must be a number above 0, at most 3000"),
        (["dnsity=3"], "KEY=VALUE: forest.stand.dnsity = 3: unknown key; did you mean density_per_ha?"),
        (["density_per_ha"], "density_per_ha: must be KEY=VALUE, as density_per_ha=400"),
        (
            ["density_per_ha=5", "species=elm"],
            'forest.stand.species[0] = "elm": must be one of "spruce", "pine", "broadleaf"',
        ),
        (["density_per_ha=900", "spacing_min_m=3"], "forest.stand.spacing_min_m = 3.0: must be at most 2.22 m"),
        (["density_per_ha=5", "--seed", "-1"], "--seed: -1: must be an integer from 0 to 4294967295"),
        (["density_per_ha=5", "seed=2", "--seed", "1"], "--seed: seed= says it as well: leave one out"),
        (["density_per_ha=5", "density_per_ha=6"], "density_per_ha=6: density_per_ha is given twice: leave one out"),
        (["density_per_ha=5", "--area-m", "-5", "60"], "--area-m: must be two numbers above 0, at most 20000"),
        (["density_per_ha=5", "--area-m", "nan", "60"], "--area-m: must be two numbers above 0, at most 20000"),
        (
            ["density_per_ha=5", "--mission", MANAGED, "--area-m", "1", "1"],
            "--area-m: is for a stand without a mission",
        ),
        (["density_per_ha=5", "--origin", "91", "0"], "--origin: must be a latitude from -85 to 85"),
    ],
)
def test_make_refuses_what_cannot_grow(argv: list[str], message: str, tmp_path: Path, capsys: Captured) -> None:
    code, _, err = run(capsys, "make", "--out", str(tmp_path / "stems.csv"), *argv)
    assert code == 2
    assert message in err
    assert not (tmp_path / "stems.csv").exists()


def test_make_without_a_tree_writes_nothing(tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "stems.csv"
    code, said, err = run(capsys, "make", "--out", str(out), "density_per_ha=0.1")
    assert (code, said) == (2, "")
    assert err == f"KEY=VALUE: forest.stand.density_per_ha = 0.1 grows no tree on 2.00 ha: {out} is not written\n"

    paper = str(EXAMPLES / "paper.toml")
    assert run(capsys, "make", "--out", str(out), "--mission", paper)[2] == (
        f"{paper}: has no trees in its [forest]: {out} is not written\n"
    )
    assert not out.exists()


def test_make_refuses_an_output_that_it_cannot_write(tmp_path: Path, capsys: Captured) -> None:
    said = run(capsys, "make", "--out", str(tmp_path / "x.shp"), "density_per_ha=5")[2]
    assert "must end in .csv, .geojson or .gpkg" in said
    assert "give --origin LAT LON" in run(capsys, "make", "--out", str(tmp_path / "x.json"), "density_per_ha=5")[2]
    code, _, err = run(capsys, "make", "--out", str(tmp_path / "none" / "x.csv"), "density_per_ha=5")
    assert (code, err) == (3, f"mission: cannot write {tmp_path}/none/x.csv: No such file or directory\n")


# import


def test_import_says_what_was_read_filled_in_and_dropped(foreign: Path, tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "stems.csv"
    code, said, _ = run(capsys, "import", str(foreign), "--utm", "32N", "--out", str(out))

    assert code == 0
    assert said.splitlines() == [
        f"{out}: 1 tree",
        "  read Easting as easting in m (it has no unit), Northing as northing in m (it has no unit), BHD as diameter "
        "at breast height in cm (it has no unit), Hoehe as height in m (it has no unit), Baumart as species, Nr as id",
        "  converted from UTM 32N",
        "  placed about the origin 46.9985682, 9.0002006",
        "  filled in the crown base of 1 of 1 tree, at 0.6 of its height",
        "  filled in the crown radius of 1 of 1 tree, by its diameter and species",
        "  dropped 1 tree without a diameter: line 3",
        "  a mission in it says where it is by",
        "    [origin]",
        "    lat_deg = 46.9985682",
        "    lon_deg = 9.0002006",
        "    alt_m = 0.0  # to be set: of the ground, above sea level",
    ]
    (tree,) = read_stems(out).trees
    assert (tree.east_m, tree.north_m) == (pytest.approx(-4.75, abs=0.02), pytest.approx(-5.0, abs=0.02))


@pytest.mark.parametrize("suffix", ["csv", "geojson", "gpkg"])
def test_what_import_says_of_the_origin_can_be_pasted_into_a_mission(
    suffix: str, foreign: Path, tmp_path: Path, capsys: Captured
) -> None:
    _, said, _ = run(capsys, "import", str(foreign), "--utm", "32N", "--out", str(tmp_path / f"stems.{suffix}"))

    file = tmp_path / "mission.toml"
    route = "[route]\nd1_enu_m = [0, 0, 4]\nd2_enu_m = [60, 0, 4]\nvel_leader_mps = 3\n"
    file.write_text(f"schema = 1\n{route}{said[said.index('[origin]') :]}")
    origin = load_mission(file).origin
    assert origin is not None
    assert (origin.lat_deg, origin.lon_deg, origin.alt_m) == (46.9985682, 9.0002006, 0.0)


def test_import_refuses_what_it_cannot_place(foreign: Path, tmp_path: Path, capsys: Captured) -> None:
    out = str(tmp_path / "stems.csv")
    assert "which zone?" in run(capsys, "import", str(foreign), "--out", out)[2]
    assert "--utm: 99: must be a zone" in run(capsys, "import", str(foreign), "--utm", "99", "--out", out)[2]
    assert "must be another file" in run(capsys, "import", str(foreign), "--out", str(foreign))[2]
    assert run(capsys, "import", str(tmp_path / "no.csv"), "--out", out)[0] == 2


# check


def test_check_says_what_stands_there(capsys: Captured) -> None:
    code, out, err = run(capsys, "check", MANAGED, NATURAL)

    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0] == f"{MANAGED}: 499 trees on 2.30 ha, 217 per hectare"
    assert lines[1] == "  basal area 17.7 m2/ha; diameters 22 to 44 cm, mean 31.9, quadratic mean 32.2"
    assert lines[3] == "     30 to 40 cm    317 ########################################"
    assert f"{NATURAL}: 886 trees on 2.30 ha, 385 per hectare, 1779 bushes" in lines
    assert lines[-1].startswith("  the widest way from d1 to d2 is about ")


def test_check_json_is_one_object_for_each_file(tmp_path: Path, capsys: Captured) -> None:
    bad = tmp_path / "stems.csv"
    bad.write_text("x,y,dbh_cm\n1,2,x\n")
    code, out, err = run(capsys, "check", "--json", LONE_TREE, str(bad))

    good, refused = json.loads(out)
    assert (code, err) == (2, "")
    assert (good["ok"], good["figures"]["trees"], good["figures"]["density_per_ha"]) == (True, 1, None)
    assert good["notes"] == ["no [sensing]: companions know the trunks at d2 and the stops alone"]
    assert (refused["ok"], refused["problems"][0]["key"]) == (False, "dbh_cm")


def test_check_goes_on_after_a_file_that_is_refused(tmp_path: Path, capsys: Captured) -> None:
    code, out, err = run(capsys, "check", str(tmp_path / "none.csv"), LONE_TREE)
    assert code == 2
    assert "none.csv: no such file" in err
    assert f"{LONE_TREE}: 1 tree\n" in out


def test_check_of_open_ground_says_so(capsys: Captured) -> None:
    assert run(capsys, "check", str(EXAMPLES / "paper.toml"))[1] == f"{EXAMPLES / 'paper.toml'}: no trees\n"


def test_check_looks_at_a_mission_in_a_stem_map(tmp_path: Path, capsys: Captured) -> None:
    stems = tmp_path / "stems.csv"
    stems.write_text("x,y,dbh_cm\n5,5,30\n130,0,40\n")
    code, _, err = run(capsys, "check", str(stems), "--mission", NATURAL)
    assert code == 2
    assert "stems.csv:2: the tree at 5.00 east, 5.00 north: stands 6.9 m from d1: must be at least 14.6 m" in err

    stems.write_text("x,y,dbh_cm\n50,5,30\n130,0,40\n")
    assert run(capsys, "check", str(stems), "--mission", NATURAL)[0] == 0
    assert "--mission: is for stem maps" in run(capsys, "check", NATURAL, "--mission", NATURAL)[2]
    stems.write_text("lat,lon,dbh_cm\n47,8,30\n")
    assert "the mission needs an [origin]" in run(capsys, "check", str(stems), "--mission", NATURAL)[2]


def test_mission_check_reads_the_stem_map_too(tmp_path: Path, capsys: Captured) -> None:
    file = tmp_path / "mapped.toml"
    route = "[route]\nd1_enu_m = [0, 0, 4]\nd2_enu_m = [60, 0, 4]\nvel_leader_mps = 3\n"
    file.write_text(f"schema = 1\n{route}[sensing]\n[forest]\nfile = 'stems.csv'\n")
    for command in (["check"], ["forest", "check"]):
        assert main([*command, str(file)]) == 2
        assert capsys.readouterr().err == f'{file}:8: forest.file = "stems.csv": no such file\n'

    (tmp_path / "stems.csv").write_text("lat,lon,dbh_cm\n47,9,30\n")
    assert main(["check", str(file)]) == 2
    said = f'{file}:8: forest.file = "stems.csv": is in degrees: the mission needs an [origin] to say where it is\n'
    assert capsys.readouterr().err == said

    (tmp_path / "stems.csv").write_text("x,y,dbh_cm\n60,0,30\n")
    assert main(["check", str(file)]) == 0
    assert "  the fence, 2 to 30 m up, reaches into 1 crown: the lowest from " in capsys.readouterr().out


def test_a_map_that_is_there_and_far_off_is_an_error_for_a_real_flight_too(tmp_path: Path, capsys: Captured) -> None:
    file = tmp_path / "mapped.toml"
    route = "[route]\nd1_enu_m = [0, 0, 4]\nd2_enu_m = [60, 0, 4]\nvel_leader_mps = 3\n"
    origin = "[origin]\nlat_deg = 0\nlon_deg = 0\nalt_m = 0\n"
    file.write_text(f"schema = 1\n{origin}{route}[sensing]\n[forest]\nfile = 'stems.csv'\n")
    assert main(["check", str(file)]) == 0  # companions need no map
    assert "  not for the simulator: " in capsys.readouterr().out

    (tmp_path / "stems.csv").write_text("lat,lon,dbh_cm\n47,9,30\n")
    assert main(["check", str(file)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "km from the origin, 0.0000000, 0.0000000: must be within 20 km" in err


# draw


def test_draw_writes_a_plan(tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "plan.svg"
    code, said, _ = run(capsys, "draw", MANAGED, "--out", str(out))
    assert (code, said) == (0, f"{out}: 499 trees\n")
    assert out.read_text().startswith("<svg ")

    stems = tmp_path / "stems.csv"
    stems.write_text("x,y,dbh_cm\n50,5,30\n130,0,40\n")
    assert run(capsys, "draw", str(stems), "--mission", MANAGED, "--out", str(out))[0] == 0
    assert ">d2</text>" in out.read_text()
    assert run(capsys, "draw", str(stems), "--out", str(out))[0] == 0
    assert ">d2</text>" not in out.read_text()
    assert "must end in .svg" in run(capsys, "draw", str(stems), "--out", str(tmp_path / "plan.png"))[2]


def test_a_plan_has_a_grid_a_scale_and_north_and_fits_its_window(tmp_path: Path, capsys: Captured) -> None:
    out, stems = tmp_path / "plan.svg", tmp_path / "stems.csv"
    stems.write_text("x,y,dbh_cm,id\n0,0,30,A<1\n100,50,30,\n")
    assert run(capsys, "draw", str(stems), "--out", str(out))[0] == 0
    root = ElementTree.fromstring(out.read_text())
    assert (root.attrib["width"], root.attrib["height"]) == ("100%", "100%")
    left, top, wide, high = (float(number) for number in root.attrib["viewBox"].split())
    texts = [(node.text, float(node.attrib["x"]), float(node.attrib["y"])) for node in root.iter(f"{SVG}text")]
    at = {text: (x, y) for text, x, y in texts}
    assert at["100"][0] == 100.0, "the line of 100 m east is labelled where it is"
    assert at["50"][0] < -5.0 or [y for text, x, y in texts if text == "50" and x < -5.0]
    assert {"10 m", "N", "metres east of the origin", "metres north"} <= at.keys()
    assert all(left <= x <= left + wide and top <= y <= top + high for _, x, y in texts)
    assert "°" not in out.read_text()
    assert "A<1" not in at

    assert run(capsys, "draw", str(stems), "--ids", "--out", str(out))[0] == 0
    (named,) = [node for node in ElementTree.fromstring(out.read_text()).iter(f"{SVG}text") if node.text == "A<1"]
    assert 0.0 < float(named.attrib["x"]) < 2.0


def test_a_plan_on_earth_has_latitudes_and_longitudes(tmp_path: Path, capsys: Captured) -> None:
    out, stems = tmp_path / "plan.svg", tmp_path / "stems.csv"
    stems.write_text("lat,lon,dbh_cm\n47.0,8.0,30\n47.0005,8.001,30\n47.0002,8.0003,30\n")
    assert run(capsys, "draw", str(stems), "--out", str(out))[0] == 0
    texts = [node.text or "" for node in ElementTree.fromstring(out.read_text()).iter(f"{SVG}text")]
    degrees = [float(text.removesuffix("°")) for text in texts if text.endswith("°")]
    assert any(46.9999 < value < 47.0006 for value in degrees)
    assert any(7.9999 < value < 8.0011 for value in degrees)
    assert "metres east of the origin, 47.0002000, 8.0003000 (WGS84)" in texts


def test_ids_that_are_not_there_are_refused(tmp_path: Path, capsys: Captured) -> None:
    code, _, err = run(capsys, "draw", MANAGED, "--ids", "--out", str(tmp_path / "plan.svg"))
    assert code == 2
    assert "has no ids of trees to draw" in err


def test_draw_of_nothing_is_refused(tmp_path: Path, capsys: Captured) -> None:
    stems = tmp_path / "stems.csv"
    stems.write_text("x,y,dbh_cm,species\n")
    assert "holds no tree" in run(capsys, "draw", str(stems), "--out", str(tmp_path / "plan.svg"))[2]

    stems.write_text("x,y,dbh_cm\n1,2,\n")
    code, _, err = run(capsys, "draw", str(stems), "--out", str(tmp_path / "plan.svg"))
    assert (code, err) == (2, f"{stems}: has nothing to draw\n")
    assert run(capsys, "check", str(stems))[1].splitlines()[:2] == [
        f"{stems}: no trees",
        "  read x as east in m (it has no unit), y as north in m (it has no unit), dbh_cm as diameter at breast "
        "height in cm",
    ]


def test_draw_says_what_it_cannot_write(tmp_path: Path, capsys: Captured) -> None:
    out = tmp_path / "none" / "plan.svg"
    assert run(capsys, "draw", MANAGED, "--out", str(out))[::2] == (
        3,
        f"mission: cannot write {out}: No such file or directory\n",
    )


# The program


@pytest.mark.parametrize("argv", [["forest"], ["forest", "grow"], ["forest", "make"], ["forest", "check"]])
def test_wrong_usage_is_exit_code_2(argv: list[str], capsys: Captured) -> None:
    with pytest.raises(SystemExit) as caught:
        main(argv)
    assert caught.value.code == 2
    assert "usage: mission forest" in capsys.readouterr().err


def test_checking_a_mission_loads_nothing_of_forests() -> None:
    code = (
        "import sys; from mission.cli.main import main; main(['check', sys.argv[1]]); "
        "names = 'stand.stand', 'stand.generate', 'stems.stem_map', 'stand.figures'; "
        "loaded = {f'mission.{name}' for name in names} & sys.modules.keys(); "
        "sys.exit(f'loaded {loaded}' if loaded else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code, LONE_TREE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
