"""Stem maps as tables: what a row is taken for, and what is refused, with its place."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import pytest

from mission.common.frames import Wgs84
from mission.common.problems import MAX_PROBLEMS, MissionError
from mission.document.model import Mission
from mission.schema.forest import MAX_STAND_TREES
from mission.stand.stand import stand_of
from mission.stems import utm
from mission.stems.geopackage_write import to_gpkg
from mission.stems.headings import Species, folded, species_of
from mission.stems.stem_files import MAX_STEM_BYTES
from mission.stems.stem_map import CROWN_BASE_SHARE, read_stems
from mission.stems.write import to_csv, to_geojson
from tests.unit.mission.stems_kit import HEADER, ORIGIN, mission_with, problems_of, says

# CSV


def test_a_row_is_a_tree_with_its_measures(written: Any) -> None:
    (tree,) = read_stems(written(HEADER + "12.345,-3.5,31.4,24.6,Picea abies\n")).trees

    assert (tree.east_m, tree.north_m, tree.radius_m, tree.height_m) == (12.35, -3.5, 0.157, 24.6)
    assert (tree.crown_base_m, tree.crown_radius_m, tree.species) == (14.8, 3.3, "Picea abies")


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("X;Y;BHD [cm];Hoehe (m)", "5,5;2,0;30,5;21,5"),
        ("x_m\ty_m\tdbh.mm\theight_dm", "5.5\t2\t305\t215"),
        ("East,North,DBH_m,h", "5.5,2.0,0.305,21.5"),
        ('"east","north","D130 (cm)","Total Height (m)"', '5.5, 2.0 ,"30.5",21.5'),
        ("north_m,plot,height,dbh,east_m", "2.0,7,2.15e1,30.5,+5.5"),
    ],
)
def test_names_units_and_separators_of_others_are_understood(written: Any, header: str, row: str) -> None:
    (tree,) = read_stems(written(f"# measured in May\n\n{header}\r\n{row}\r\n")).trees

    assert (tree.east_m, tree.north_m, tree.height_m) == (5.5, 2.0, 21.5)
    assert tree.radius_m == pytest.approx(0.1525)


def test_what_was_understood_filled_in_and_ignored_is_said(written: Any) -> None:
    stems = read_stems(written("x,y,dbh,h,spp,plot\n1,2,30,,fichte,a\n5,6,20,15,Sorbus,b\n8,8,22,16,,c\n"))

    assert stems.notes == (
        "read x as east in m (it has no unit), y as north in m (it has no unit), dbh as diameter at breast height in "
        "cm (it has no unit), h as height in m (it has no unit), spp as species",
        "not read: plot",
        "filled in the height of 1 of 3 trees, by the curve of its diameter and species",
        f"filled in the crown base of 3 of 3 trees, at {CROWN_BASE_SHARE} of its height",
        "filled in the crown radius of 3 of 3 trees, by its diameter and species",
        'took "Sorbus" for broadleaves: a species that is not known',
        "took trees without a species for broadleaves",
    )
    assert stems.trees[0].height_m == 19.3  # a spruce of 0.3 m


def test_a_map_of_ours_is_read_back_without_loss(written: Any) -> None:
    grown = stand_of(_wooded())
    everything = (*grown.trees, *grown.bushes)

    from_csv = read_stems(written(to_csv(everything)))
    assert (from_csv.trees, from_csv.bushes) == (grown.trees, grown.bushes)
    from_json = read_stems(written(to_geojson(everything, ORIGIN), "stems.geojson"), origin=ORIGIN)
    assert (from_json.trees, from_json.bushes) == (grown.trees, grown.bushes)
    for origin in (ORIGIN, None):
        from_gpkg = read_stems(written(to_gpkg(everything, origin), "stems.gpkg"), origin=origin)
        assert (from_gpkg.trees, from_gpkg.bushes) == (grown.trees, grown.bushes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "stems.csv: holds nothing: must have a header and a line for each tree"),
        (HEADER, "stems.csv: holds no tree"),
        ("dbh_cm,height_m\n30,20\n", "stems.csv:1: must say where trees stand: lat and lon, east_m and north_m, or"),
        ("x,y,height\n1,2,20\n", "stems.csv:1: must have a column dbh_cm, dbh_mm or dbh_m"),
        ("x,y,DBH (in)\n1,2,12\n", '(found: x, y, DBH (in)); convert "DBH (in)": inches and feet are not read'),
        ("x,y,dbh_cm,dbh_mm\n1,2,3,30\n", 'stems.csv:1: "dbh_cm" and "dbh_mm" are both the diameter at breast height'),
        ("x,y,lat,lon,dbh_cm\n1,2,47,8,30\n", "stems.csv:1: has the place in more than one way"),
        ("x,y,dbh\n1,2,0.3\n4,5,0.2\n", 'stems.csv: "dbh" has no unit and no value above 3: name it dbh_m, dbh_cm or'),
        ("x,y,dbh\n1,2,300\n4,5,250\n7,8,90\n", 'stems.csv: "dbh" has no unit, and most values are above 100: name it'),
        (HEADER + "1,2,30\n", "stems.csv:2: has 3 fields: must have 5, as the header"),
        (HEADER + '1,2,"30,20,oak\n', "stems.csv:2: is not CSV: unexpected end of data"),
        (HEADER + "1,2,nan,20,oak\n", 'stems.csv:2: dbh_cm = "nan": must be a number from 0.5 to 500 cm'),
        (HEADER + "1,2,inf,20,oak\n", 'stems.csv:2: dbh_cm = "inf": must be a number from 0.5 to 500 cm'),
        (HEADER + "1,2,1_0,20,oak\n", 'stems.csv:2: dbh_cm = "1_0": must be a number'),
        (HEADER + "1,2,٣٠,20,oak\n", 'stems.csv:2: dbh_cm = "٣٠": must be a number'),
        (HEADER + "1,2,9e99,20,oak\n", 'stems.csv:2: dbh_cm = "9e99": must be a number from 0.5 to 500 cm'),
        (HEADER + "1,2,-30,20,oak\n", 'stems.csv:2: dbh_cm = "-30": must be a number from 0.5 to 500 cm'),
        (HEADER + "1,2,30,2000,oak\n", 'stems.csv:2: height_m = "2000": must be a number from 0.1 to 130 m'),
        (HEADER + "1,,30,20,oak\n", "stems.csv:2: north_m: missing: where does it stand?"),
        (HEADER + "1,2,NA,20,oak\n", "stems.csv:2: dbh_cm: missing; `mission forest import` drops trees without"),
        (
            HEADER + "1,2,30,20,oak\n3,4,30,20,oak\n1,2,31,20,oak\n",
            "stems.csv:4: a tree stands at 1.00 east, 2.00 north",
        ),
        (HEADER + "443000,5200000,30,20,oak\n", "east_m"),
        (
            "easting,northing,dbh_cm\n443000,5200000,30\n",
            'stems.csv: has "easting" and "northing": which zone? `mission',
        ),
        (HEADER + "1,2,30,20,oak\0\n", "stems.csv:2: is not text: a NUL byte"),
        (HEADER + "1,2,30,20," + "k" * 10_001 + "\n", "stems.csv:2: is longer than 10000 characters"),
        (
            "x,y,dbh_cm," + ",".join(f"c{k}" for k in range(200)) + "\n",
            "stems.csv:1: has 203 columns: must have at most",
        ),
        (b"\xff\xfe\x00", "stems.csv: not UTF-16 text, as its first two bytes say"),
        (b"\x89PNG\r\n\x1a\n", "stems.csv:1: not UTF-8 text: byte 0x89"),
        (
            "x,y,dbh_cm,height_m,crown_base_m\n1,2,30,20,21\n",
            'stems.csv:2: crown_base_m = "21": must be at most the tree\'s height, 20 m',
        ),
    ],
)
def test_what_is_wrong_with_a_csv_is_named_with_its_line_column_and_value(
    written: Any, text: str | bytes, message: str
) -> None:
    assert message in "\n".join(map(str, problems_of(written(text))))


def test_every_problem_of_a_file_is_named_up_to_a_hundred(written: Any) -> None:
    problems = problems_of(written(HEADER + "".join(f"{k},0,x,y,oak\n" for k in range(200))))

    assert [str(p).rpartition("/")[2] for p in problems[:2]] == [
        'stems.csv:2: dbh_cm = "x": must be a number from 0.5 to 500 cm',
        'stems.csv:2: height_m = "y": must be a number from 0.1 to 130 m',
    ]
    assert len(problems) == MAX_PROBLEMS + 1
    assert problems[-1].message == "and 300 more problems"


def test_a_file_that_is_none_or_too_large_is_refused(tmp_path: Path, written: Any) -> None:
    assert "no such file" in str(problems_of(tmp_path / "none.csv")[0])
    assert "is a directory" in str(problems_of(_folder(tmp_path / "d.csv"))[0])
    assert "must be a stem map: .csv, .geojson or .gpkg" in says(written("", "stems.shp"))
    assert f"must be at most {MAX_STEM_BYTES // 1024} KiB" in says(written(b"\n" * (MAX_STEM_BYTES + 1)))
    assert "has 40001 lines: must have at most 40000" in says(written("\n" * 40_001))
    rows = "".join(f"{k // 1000},{k % 1000},30,20,oak\n" for k in range(MAX_STAND_TREES + 1))
    assert f"holds {MAX_STAND_TREES + 1} trees: must be at most {MAX_STAND_TREES}" in says(written(HEADER + rows))


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("1,2,3\n" * (MAX_STEM_BYTES // 6), "s.csv"),
        ("\n" * MAX_STEM_BYTES, "s.csv"),
        (HEADER + ("\n" + "x" * 9_999) * 830, "s.csv"),
        (HEADER + '"' * (MAX_STEM_BYTES - 100), "s.csv"),
        (HEADER + "".join(f"{k},{k},x,x,x\n" for k in range(10_000)), "s.csv"),
        ('{"type":"FeatureCollection","features":[' + "[]," * 2_000_000 + "[]]}", "s.json"),
        ('{"type":"FeatureCollection","features":[' + "{}," * 19_000 + "{}]}", "s.json"),
        ("9" * MAX_STEM_BYTES, "s.json"),
        ('"features":[' * 600_000, "s.json"),
    ],
    ids=["rows", "newlines", "long lines", "quotes", "problems", "features", "objects", "digits", "nested"],
)
def test_the_worst_files_are_refused_in_time(text: str, name: str, written: Any) -> None:
    file = written(text, name)
    start_s = time.process_time()
    assert problems_of(file)
    # Measured: up to 0.5 s. The slack is for busy machines; what counts is that nothing explodes
    assert time.process_time() - start_s < 5.0


def test_import_drops_what_has_no_diameter_or_stands_there_twice_and_says_so(written: Any) -> None:
    text = HEADER + "1,2,30,20,oak\n3,4,,20,oak\n5,6,NA,20,oak\n1.001,2,31,20,oak\n"
    stems = read_stems(written(text), lenient=True)

    assert [tree.radius_m for tree in stems.trees] == [0.15]
    assert stems.notes[-2:] == (
        "dropped 2 trees without a diameter: lines 3, 4",
        "dropped 1 tree in the place of another: line 5",
    )


def test_heights_in_feet_are_told(written: Any) -> None:
    stems = read_stems(written("x,y,dbh_cm,height_ft,plot_ft\n1,2,30,60,4\n"))

    assert stems.notes[1:3] == (
        "not read: height_ft, plot_ft",
        "convert height_ft to metres to have it read: inches and feet are not",
    )


def test_what_was_filled_in_is_counted_of_the_trees_that_are_kept(written: Any) -> None:
    """Not of one that stands there twice, nor of bushes."""
    stems = read_stems(written("x,y,dbh,spp\n1,2,30,oak\n1,2,30,oak\n5,6,20,oak\n7,8,40,undergrowth\n"), lenient=True)

    filled = [note for note in stems.notes if note.startswith("filled in")]
    assert all(" of 2 of 2 trees, " in note for note in filled)
    assert filled[0] == "filled in the height of 2 of 2 trees, by the curve of its diameter and species"


def test_a_tree_that_stands_there_twice_hides_no_other_problem(written: Any) -> None:
    problems = problems_of(written(HEADER + "1,2,30,20,oak\n1,2,30,20,oak\n3,5,,20,oak\n1,2,30,,oak\n"))
    assert [problem.line for problem in problems] == [3, 4, 5]


# On Earth


def test_latitude_and_longitude_are_placed_about_the_missions_origin(written: Any) -> None:
    north_m_per_deg, east_m_per_deg = 111_170.0, 76_061.0  # at 47 degrees, 400 m up
    text = f"latitude,longitude,dbh_cm\n{47 + 50 / north_m_per_deg:.9f},{8 - 30 / east_m_per_deg:.9f},30\n"
    (tree,) = read_stems(written(text), origin=ORIGIN).trees

    assert (tree.east_m, tree.north_m) == (pytest.approx(-30.0, abs=0.02), pytest.approx(50.0, abs=0.02))


def test_a_map_on_earth_without_an_origin_has_its_own_in_its_middle(written: Any) -> None:
    stems = read_stems(written("lat,lon,dbh_cm\n47.0,8.0,30\n47.001,8.002,30\n"))

    assert stems.origin == Wgs84(47.0005, 8.001, 0.0)
    assert stems.trees[0].east_m == pytest.approx(-stems.trees[1].east_m, abs=0.02)
    assert "placed about the origin 47.0005000, 8.0010000" in stems.notes


def test_a_wrong_place_is_named_and_no_other(written: Any) -> None:
    good = "".join(f"{47 + k * 1e-5:.5f},{9 + k % 7 * 1e-5:.5f},30\n" for k in range(300))
    told = says(written(f"lat,lon,dbh_cm\n{good}0,0,28\n"))

    assert told.startswith('stems.csv:302: lat = "0": stands ')
    assert told.endswith(" km from the origin, 47.0014900, 9.0000300: must be within 20 km")


def test_a_stand_may_lie_across_180_degrees(written: Any) -> None:
    stems = read_stems(written("lat,lon,dbh_cm\n-17,179.9999,30\n-17,-179.9999,30\n-17,-179.9998,20\n"))

    assert stems.origin == Wgs84(-17.0, -179.9999, 0.0)
    assert [tree.east_m for tree in stems.trees] == pytest.approx([-21.3, 0.0, 10.6], abs=0.1)
    for name, map_of in (("s.geojson", to_geojson), ("s.gpkg", to_gpkg)):
        text: Any = map_of(stems.trees, stems.origin)
        assert read_stems(written(text, name), origin=stems.origin).trees == stems.trees


def test_a_map_far_from_the_origin_is_refused(written: Any) -> None:
    assert says(written("lat,lon,dbh_cm\n48,8,30\n"), origin=ORIGIN) == (
        'stems.csv:2: lat = "48": stands 111 km from the origin, 47.0000000, 8.0000000: must be within 20 km'
    )


@pytest.mark.parametrize(
    ("lat", "lon", "is_swapped"),
    [
        ("8.01", "47.02", True),
        ("139.7", "35.6", True),
        ("-139.7", "35.6", True),
        ("8.5", "47", False),
        ("7", "86", False),
    ],
)
def test_latitude_and_longitude_the_wrong_way_round_are_told(
    written: Any, lat: str, lon: str, is_swapped: bool
) -> None:
    """Where it can be known: about the origin, or for a latitude that is none."""
    told = says(written(f"lat,lon,dbh_cm\n{lat},{lon},30\n"), origin=ORIGIN)
    assert told.endswith("; are latitude and longitude swapped?") == is_swapped


@pytest.mark.parametrize(
    ("lat", "lon", "message"),
    [
        ("91", "8", 'lat = "91": must be a number from -85 to 85 degrees'),
        ("47", "181", 'lon = "181": must be a number from -180 to 180 degrees'),
        ("5200000", "443000", 'lat = "5200000": must be'),
    ],
)
def test_degrees_that_are_none_are_refused(written: Any, lat: str, lon: str, message: str) -> None:
    assert message in str(problems_of(written(f"lat,lon,dbh_cm\n{lat},{lon},30\n"))[0])


@pytest.mark.parametrize(
    ("text", "zone"),
    [
        ("32N", "UTM 32N"),
        ("utm 32n", "UTM 32N"),
        ("UTM zone 7S", "UTM 7S"),
        ("EPSG:32632", "UTM 32N"),
        ("epsg::32707", "UTM 7S"),
        ("25833", "UTM 33N"),
        ("EPSG:3006", "UTM 33N"),
        ("3067", "UTM 35N"),
    ],
)
def test_zones_are_known_by_their_names(text: str, zone: str) -> None:
    assert str(utm.zone_of(text)) == zone


@pytest.mark.parametrize("text", ["", "32", "0N", "61N", "EPSG:4326", "EPSG:31467", "32X", "-3N"])
def test_what_names_no_zone_is_none(text: str) -> None:
    assert utm.zone_of(text) is None


@pytest.mark.parametrize(
    ("east_m", "north_m", "zone", "lat_deg", "lon_deg"),
    [  # as GeographicLib's GeoConvert has them
        (444_500.0, 3_688_500.0, "38N", 33.33424, 44.40363),
        (444_140.54, 3_684_706.36, "38N", 33.3, 44.4),
        (500_000.0, 0.0, "32N", 0.0, 9.0),
        (500_000.0, 10_000_000.0, "60S", 0.0, 177.0),
    ],
)
def test_utm_is_converted_as_others_do(
    east_m: float, north_m: float, zone: str, lat_deg: float, lon_deg: float
) -> None:
    known = utm.zone_of(zone)
    assert known is not None
    assert utm.to_wgs84(east_m, north_m, known) == (pytest.approx(lat_deg, abs=6e-6), pytest.approx(lon_deg, abs=6e-6))


def test_along_the_central_meridian_northings_are_the_meridians_length() -> None:
    """The ellipsoid's meridian, by Simpson's rule, and the scale of UTM."""
    square, steps, lat_rad = 6.69437999014e-3, 2000, math.radians(47.0)

    def radius(lat: float) -> float:
        return 6378137.0 * (1.0 - square) / (1.0 - square * math.sin(lat) ** 2) ** 1.5

    h = lat_rad / steps
    odd = sum(radius((2 * k + 1) * h) for k in range(steps // 2))
    even = sum(radius(2 * k * h) for k in range(1, steps // 2))
    length_m = h / 3.0 * (radius(0.0) + 4.0 * odd + 2.0 * even + radius(lat_rad))
    lat_deg, lon_deg = utm.to_wgs84(500_000.0, 0.9996 * length_m, utm.Zone(32, south=False))
    assert (lat_deg, lon_deg) == (pytest.approx(47.0, abs=1e-9), 9.0)


def test_distances_survive_the_conversion(written: Any) -> None:
    """Two trees 100 m apart in UTM, at k = 0.9996 on the central meridian: 100.04 m on the ground at sea level."""
    text = "easting,northing,dbh_cm\n500000,5205000,30\n500000,5205100,30\n"
    a, b = read_stems(written(text), zone=utm.zone_of("32N")).trees

    assert math.hypot(a.east_m - b.east_m, a.north_m - b.north_m) == pytest.approx(100.04, abs=0.015)
    assert "has no easting and northing, which UTM 32N is the zone of" in says(
        written(HEADER + "1,2,30,20,oak\n"), zone=utm.zone_of("32N")
    )


# In a mission


def _wooded() -> Mission:
    return mission_with(stand={"density_per_ha": 300, "undergrowth_per_ha": 200, "seed": 4})


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("Weißtanne", Species.SPRUCE),
        ("Waldkiefer", Species.PINE),
        ("Europäische Lärche", Species.SPRUCE),
        ("Stieleiche", Species.BROADLEAF),
        ("Sorbus", None),
        ("Etanne", Species.SPRUCE),
    ],
)
def test_compound_names_are_of_the_kind_that_they_end_with(name: str, kind: Species | None) -> None:
    found = [species_of(word) for word in folded(name).split("_")]
    assert next((one for one in found if one is not None), None) is kind


@pytest.mark.parametrize(("easting", "zone"), [("32567025.97", 32), ("3567025.97", 3)])
def test_an_easting_behind_its_zones_number_is_told_so(tmp_path: Path, easting: str, zone: int) -> None:
    file = tmp_path / "s.csv"
    file.write_text(f"easting,northing,dbh_cm\n{easting},5400000,30\n")
    with pytest.raises(MissionError, match=rf"it begins with a zone's number, {zone}: take that off if it is UTM"):
        read_stems(file, zone=utm.zone_of("32N"))
