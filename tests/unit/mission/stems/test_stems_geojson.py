"""Stem maps as GeoJSON, and what becomes of a map beside a mission."""

from __future__ import annotations

import json
from typing import Any

import pytest

from mission.common.problems import MAX_PROBLEMS, MissionError
from mission.stand.stand import StandTree, stand_of
from mission.stems.stem_map import read_stems
from mission.stems.write import to_csv
from tests.unit.mission.stems_kit import HEADER, ORIGIN, mission_with, problems_of, says


def feature(lon: object = 8.0, lat: object = 47.0, **properties: object) -> dict[str, Any]:
    point = {"type": "Point", "coordinates": [lon, lat]}
    return {"type": "Feature", "geometry": point, "properties": {"dbh_cm": 30, **properties}}


def collection(*features: object, **members: object) -> str:
    return json.dumps({"type": "FeatureCollection", **members, "features": list(features)}, indent=1)


# GeoJSON


def test_a_feature_is_a_tree(written: Any) -> None:
    text = collection(feature(8.0, 47.0, height=21, species="Pinus sylvestris", x=5), feature(8.001, 47.0, dbh_cm="25"))
    stems = read_stems(written(text, "s.geojson"), origin=ORIGIN)

    assert [(t.radius_m, t.species) for t in stems.trees] == [(0.15, "Pinus sylvestris"), (0.125, "")]
    assert stems.trees[0].height_m == 21.0
    assert stems.trees[1].east_m == pytest.approx(76.06, abs=0.02)


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326", "EPSG:4326"])
def test_an_old_crs_that_is_wgs84_after_all_is_let_pass(written: Any, name: str) -> None:
    crs = {"type": "name", "properties": {"name": name}}
    assert read_stems(written(collection(feature(), crs=crs), "s.json")).trees


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "s.geojson:1: not JSON: Expecting property name enclosed in double quotes (column 2)"),
        ("[]", 's.geojson: must be a GeoJSON object with "type": "FeatureCollection"'),
        ('{"type": "Topology"}', 's.geojson: must be a GeoJSON object with "type": "FeatureCollection"'),
        ('{"type": "FeatureCollection", "features": 3}', "s.geojson: features = 3: must be an array of Features"),
        (collection(), "s.geojson: holds no tree"),
        ("[" * 100_000, "s.geojson: nested too deep"),
        (collection(feature()).replace("30", "NaN"), "s.geojson: not JSON: NaN is no number"),
        (collection(feature()).replace("30", "-Infinity"), "s.geojson: not JSON: -Infinity is no number"),
        (collection(feature()).replace("30", "9" * 5000), "s.geojson: not JSON: Exceeds the limit"),
        (collection(feature()).replace("30", "1e999"), "features[0].properties.dbh_cm = inf: must be a number"),
        (collection(feature(dbh_cm=True)), "s.geojson:4: features[0].properties.dbh_cm = true: must be a number"),
        (collection(feature(dbh_cm=[30])), "features[0].properties.dbh_cm = [30]: must be a number"),
        (
            collection(feature(), feature(8.1, dbh_cm="thick")),
            'features[1].properties.dbh_cm = "thick": must be a number',
        ),
        (collection(feature(), feature(8.1, species=4)), "features[1].properties.species = 4: must be text"),
        (collection(feature(), 7), 's.geojson:17: features[1]: must be an object with "type": "Feature"'),
        (
            collection({**feature(), "geometry": {"type": "Polygon", "coordinates": []}}),
            's.geojson:4: features[0]: geometry is "Polygon": must be a Point, the trunk\'s axis',
        ),
        (collection({**feature(), "geometry": None}), "features[0]: geometry is null: must be a Point"),
        (collection({**feature(), "properties": None}), "must have a column dbh_cm"),
        (collection(feature(), {**feature(), "properties": None}), "features[1]: properties: must be an object"),
        (
            collection({**feature(), "geometry": {"type": "Point", "coordinates": [8]}}),
            "features[0]: geometry.coordinates = [8]: must be longitude and latitude",
        ),
        (collection(feature("8", None)), "features[0].geometry.coordinates[1]: missing: where does it stand?"),
        (
            collection(feature(443000, 5200000)),
            "geometry.coordinates[0] = 443000: must be a number from -180 to 180 degrees",
        ),
        (
            collection(feature(), crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}),
            'crs = "urn:ogc:def:crs:EPSG::25832": GeoJSON is WGS84, longitude and latitude (RFC 7946)',
        ),
        (collection(feature(), crs=None), "s.geojson: crs = null: GeoJSON is WGS84"),
        (
            collection(feature(), crs={"type": "link", "properties": {"href": "x"}}),
            "s.geojson: crs = a table: GeoJSON is",
        ),
        (
            collection(*(feature(8 + k / 1e4, **{f"p{k}": 1}) for k in range(210))),
            "s.geojson: has more than 200 different properties",
        ),
    ],
)
def test_what_is_wrong_with_a_geojson_is_named_with_its_feature(written: Any, text: str, message: str) -> None:
    assert message in "\n".join(map(str, problems_of(written(text, "s.geojson"), origin=ORIGIN)))


def test_a_feature_that_cannot_be_placed_in_the_text_has_no_line(written: Any) -> None:
    """Another member called features comes first."""
    text = json.dumps({"type": "FeatureCollection", "more": {"features": []}, "features": [feature(), 7]})
    assert "s.geojson: features[1]: must be an object" in says(written(text, "s.geojson"))


def test_a_missions_stem_map_stands_beside_it(written: Any) -> None:
    file = written(HEADER + "60,0,40,25,oak\n30,1,20,15,pine\n")
    own = {"base_enu_m": (20.0, 9.0), "trunk_radius_m": 0.3, "height_m": 12.0}
    stand = stand_of(mission_with(file=file.name, trees=(own,), grade=(0.02, 0.0)), file.parent)

    assert sorted(tree.east_m for tree in stand.trees) == [20.0, 30.0, 60.0]
    assert stand.ground_up_m(30.0, 0.0) == 0.6


def test_a_tree_where_vehicles_start_is_refused_with_its_line(written: Any) -> None:
    file = written(HEADER + "60,0,40,25,oak\n0.5,0.9,20,15,pine\n")
    with pytest.raises(MissionError) as caught:
        stand_of(mission_with(file=file.name), file.parent)

    assert str(caught.value).endswith(
        "stems.csv:3: the tree at 0.50 east, 0.90 north: stands 0.9 m from d1: must be at least 1.0 m, outside the "
        "starting points"
    )


def test_of_many_wrong_features_the_first_are_named_and_the_others_counted(written: Any) -> None:
    text = json.dumps({"type": "FeatureCollection", "features": [feature(), *[7] * (MAX_PROBLEMS + 30)]})
    *named, more = problems_of(written(text, "s.geojson"))
    assert len(named) == MAX_PROBLEMS
    assert more.message == "and 30 more problems"


def test_a_trunk_at_d2_that_is_thicker_than_what_is_kept_from_it_is_refused_with_its_line(written: Any) -> None:
    file = written(HEADER + "30,1,20,15,pine\n60,1.5,120,25,oak\n")
    mission = mission_with(file=file.name)
    with pytest.raises(MissionError) as caught:
        stand_of(mission, file.parent)
    assert str(caught.value).endswith(
        "stems.csv:3: the tree at 60.00 east, 1.50 north: reaches 2.10 m from d2: must be at most "
        "coverage.keep_out_m = 2"
    )
    sphere = mission.coverage.model_copy(update={"shape": "sphere"})
    assert len(stand_of(mission.model_copy(update={"coverage": sphere}), file.parent).trees) == 2


def test_a_map_in_degrees_needs_the_missions_origin(written: Any) -> None:
    file = written("lat,lon,dbh_cm\n47.001,8.0,30\n")
    with pytest.raises(MissionError, match=r"is in degrees: the mission needs an \[origin\]"):
        stand_of(mission_with(file=file.name), file.parent)
    origin = {"lat_deg": 47.0, "lon_deg": 8.0, "alt_m": 400.0}

    (tree,) = stand_of(mission_with(origin, file=file.name), file.parent).trees
    assert tree.north_m == pytest.approx(111.17, abs=0.02)


def test_a_map_cannot_be_found_for_a_mission_that_was_read_from_no_file() -> None:
    with pytest.raises(MissionError, match="this mission was read from none"):
        stand_of(mission_with(file="stems.csv"))


@pytest.mark.parametrize(
    "name", ["../stems.csv", "/etc/stems.csv", "a\\b.csv", "stems.shp", "c:stems.csv", ".csv\n", ""]
)
def test_only_a_name_beside_the_mission_is_taken(name: str) -> None:
    with pytest.raises(ValueError, match="must be the name of a"):
        mission_with(file=name)


def test_a_stand_is_grown_or_measured() -> None:
    with pytest.raises(ValueError, match=r"must be left out with \[forest.stand\]: a stand is grown or measured"):
        mission_with(file="stems.csv", stand={"density_per_ha": 300})


def test_quotes_and_commas_in_a_species_survive(written: Any) -> None:
    tree = StandTree(1.0, 2.0, 0.1, 9.0, 5.0, 1.0, 'oak, "old" #3')

    assert read_stems(written(to_csv([tree]))).trees == (tree,)
