"""Stem maps as foresters have them: eight languages, as R, QGIS and Excel write them on their machines.

The files are generated here by what these programs document of their formats: R's `write.csv2` (semicolons, decimal
commas, row names below an empty heading, strings quoted, NA; the encoding of the machine), GDAL's CSV driver that QGIS
exports by (GEOMETRY=AS_XY puts X and Y first; decimal points, WRITE_BOM), Excel's "CSV (separated by the list
separator)" (decimal sign and code page of Windows' region, CRLF, empty rows at the end) and "Unicode text" (UTF-16 with
a byte order mark, tabs).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from mission.cli.main import main
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE
from mission.schema.trees import crown_radius_of_m, height_of_m
from mission.stems.headings import species_of
from mission.stems.stem_map import read_stems
from tests.unit.mission.stems_kit import problems_of, says


class Tongue(NamedTuple):
    """Headings of a language: id, east, north, diameter in cm, height, species, a remark that means nothing to us."""

    headings: tuple[str, str, str, str, str, str, str]
    species: tuple[str, str]
    remark: str
    code_page: str = "cp1252"
    point: bool = False  # decimal sign of Windows' region; its list separator is then the comma


TONGUES = {
    "German": Tongue(
        ("Baum-Nr.", "Ost [m]", "Nord [m]", "BHD [cm]", "Höhe (m)", "Baumart", "Schäden"), ("Lärche", "Föhre"), "Käfer"
    ),
    "French": Tongue(
        ("N° arbre", "Est (m)", "Nord (m)", "Diamètre (cm)", "Hauteur totale (m)", "Essence", "État"),
        ("Épicéa", "Hêtre"),
        "sec à moitié",
    ),
    "Finnish": Tongue(
        ("Puu nro", "Itä (m)", "Pohjoinen (m)", "Läpimitta (cm)", "Pituus (m)", "Puulaji", "Lisätieto"),
        ("Kuusi", "Mänty"),
        "mäellä",
    ),
    "Swedish": Tongue(
        ("Träd nr", "Öst (m)", "Nord (m)", "Brösthöjdsdiameter (cm)", "Höjd (m)", "Trädslag", "Anmärkning"),
        ("Gran", "Björk"),
        "på åsen",
    ),
    "Spanish": Tongue(
        ("Nº", "Este (m)", "Norte (m)", "DAP (cm)", "Altura (m)", "Especie", "Año"), ("Pino", "Haya"), "2025"
    ),
    "Portuguese": Tongue(
        ("Nº", "Leste (m)", "Norte (m)", "Diâmetro (cm)", "Altura em m", "Espécie", "Observação"),
        ("Pinheiro", "Carvalho"),
        "inclinação",
    ),
    "Polish": Tongue(
        ("Nr drzewa", "Wschód (m)", "Północ (m)", "Pierśnica (cm)", "Wysokość w m", "Gatunek", "Uszkodzenia"),
        ("Świerk", "Dąb"),
        "część górna",
        "cp1250",
    ),
    "English": Tongue(
        ("Tree ID", "East (m)", "North_m", "dbh_cm", "Total height [m]", "Species", "Façade"),
        ("Spruce", "Oak"),
        "naïve",
        point=True,
    ),
}
# id, east m, north m, diameter cm, height m: with three digits after the sign, and with thousands
TREES = (("7", 12.345, -3.5, 31.4, 24.6), ("A 12", 1204.75, 2.25, 46.0, None), ("9", 5.125, 8.0, 18.25, 15.0))


class File(NamedTuple):
    data: bytes
    unread: tuple[str, ...]  # headings that must be named
    first: tuple[str, ...] = ()  # names instead of east and north


def comma(value: float | None, missing: str) -> str:
    return missing if value is None else f"{value:.12g}".replace(".", ",")


def point(value: float | None, missing: str) -> str:
    return missing if value is None else f"{value:.12g}"


def quoted(text: str) -> str:
    return f'"{text}"'


def rows(t: Tongue) -> list[tuple[Any, ...]]:
    names = (*t.species, "")
    return [(*tree, names[k], t.remark) for k, tree in enumerate(TREES)]


def write_csv2(t: Tongue, encoding: str, newline: str) -> File:
    """R: write.csv2(trees, file): row.names, quote = TRUE, na = "NA"."""
    lines = [";".join(map(quoted, ("", *t.headings)))]
    for k, (name, east, north, dbh, height, species, remark) in enumerate(rows(t), start=1):
        numbers = [comma(value, "NA") for value in (east, north, dbh, height)]
        species = quoted(species) if species else "NA"
        lines.append(";".join([quoted(str(k)), quoted(name), *numbers, species, quoted(remark)]))
    return File((newline.join(lines) + newline).encode(encoding), ("column 1 (it has no heading)", t.headings[6]))


def qgis(t: Tongue, encoding: str, separator: str) -> File:
    """QGIS, Save features as CSV with GEOMETRY=AS_XY: X and Y first; strings quoted where they would be numbers."""
    headings = ("X", "Y", t.headings[0], *t.headings[3:])
    lines = [separator.join(quoted(h) if separator in h else h for h in headings)]
    for name, east, north, dbh, height, species, remark in rows(t):
        name, remark = (quoted(text) if text.isdigit() else text for text in (name, remark))
        lines.append(
            separator.join(
                [point(east, ""), point(north, ""), name, point(dbh, ""), point(height, ""), species, remark]
            )
        )
    return File(("\r\n".join(lines) + "\r\n").encode(encoding), (t.headings[6],), ("X", "Y"))


def excel_csv(t: Tongue) -> File:
    """Excel, CSV: list separator and decimal sign of the region, its code page; emptied rows stay as separators."""
    separator, decimal = (",", point) if t.point else (";", comma)
    lines = [separator.join(t.headings)]
    for name, east, north, dbh, height, species, remark in rows(t):
        lines.append(separator.join([name, *(decimal(v, "") for v in (east, north, dbh, height)), species, remark]))
    lines += [separator * 6] * 2
    return File(("\r\n".join(lines) + "\r\n").encode(t.code_page), (t.headings[6],))


def excel_unicode(t: Tongue) -> File:
    """Excel, Unicode text: UTF-16, tabs; numbers as the cells show them, thousands apart as in the region."""
    decimal = point if t.point else comma
    thousands = (
        "," if t.point else "\u00a0" if t.headings[0] in ("N° arbre", "Puu nro", "Träd nr", "Nr drzewa") else "."
    )
    lines = ["\t".join(t.headings)]
    for name, east, north, dbh, height, species, remark in rows(t):
        cells = [decimal(v, "") for v in (east, north, dbh, height)]
        cells = [f"{c[0]}{thousands}{c[1:]}" if c.startswith("1204") else c for c in cells]
        cells = [quoted(c) if "," in c else c for c in cells]
        lines.append("\t".join([name, *cells, species, remark]))
    return File(("\r\n".join(lines) + "\r\n").encode("utf-16"), (t.headings[6],))


WRITERS: dict[str, Callable[[Tongue], File]] = {
    "write.csv2 on Linux": lambda t: write_csv2(t, "utf-8", "\n"),
    "write.csv2 on Windows": lambda t: write_csv2(t, t.code_page, "\r\n"),
    "QGIS with BOM": lambda t: qgis(t, "utf-8-sig", ","),
    "Excel CSV": excel_csv,
    "Excel Unicode text": excel_unicode,
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("language", TONGUES)
def test_a_foreign_map_is_read_right_and_what_is_not_read_is_named(language: str, writer: str, written: Any) -> None:
    tongue = TONGUES[language]
    file = WRITERS[writer](tongue)
    stems = read_stems(written(file.data, "stems.txt" if "text" in writer else "stems.csv"))

    assert [stem.id for stem in stems.stems] == [tree[0] for tree in TREES]
    for (_, east_m, north_m, dbh_cm, height_m), tree, species in zip(
        TREES, stems.trees, (*tongue.species, ""), strict=True
    ):
        kind = species_of(bare(species)) if species else species_of("broadleaf")
        assert (tree.east_m, tree.north_m) == (round(east_m, 2), north_m)
        assert tree.radius_m == pytest.approx(dbh_cm / 200.0)
        assert tree.height_m == (height_m or height_of_m(dbh_cm / 100.0, kind))
        assert tree.crown_radius_m == crown_radius_of_m(round(dbh_cm / 100.0, 4), kind)
        assert tree.species == species
    unread = [note for note in stems.notes if note.startswith("not read: ")]
    assert unread == [f"not read: {', '.join(file.unread)}"]
    read = next(note for note in stems.notes if note.startswith("read "))
    for heading in (*(file.first or tongue.headings[1:3]), *tongue.headings[3:6]):
        assert f"{heading} as " in read
    guessed = [note for note in stems.notes if note.startswith("taken for ")]
    is_guessed = writer in ("write.csv2 on Windows", "Excel CSV")
    page = {"cp1252": "Windows-1252", "cp1250": "Windows-1250"}[tongue.code_page]
    assert guessed == [f"taken for {page} text: it is not UTF-8"] * is_guessed


def bare(species: str) -> str:
    """Written by hand: the names above without their accents."""
    names = {"Lärche": "larche", "Föhre": "fohre", "Épicéa": "epicea", "Hêtre": "hetre", "Mänty": "manty"}
    names |= {"Björk": "bjork", "Świerk": "swierk", "Dąb": "dab"}
    return names.get(species, species.lower())


@pytest.mark.parametrize("language", TONGUES)
def test_a_column_that_is_not_understood_refuses_the_file_or_is_mapped(
    language: str, written: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """Diameters under a heading of one's own: named, and read when `--column` says what they are."""
    tongue = TONGUES[language]
    own = tongue._replace(headings=(*tongue.headings[:3], "Mätning 7", *tongue.headings[4:]), code_page="cp1252")
    file = written(write_csv2(own, "utf-8", "\n").data)
    assert "must have a column dbh_cm" in says(file)
    assert "Mätning 7" in says(file)

    out = file.with_name("out.csv")
    command = ["forest", "import", str(file), "--out", str(out)]
    assert main([*command, "--column", "dbh_mm=Mätning 7", "--column", "id="]) == EXIT_DONE
    said = capsys.readouterr().out
    assert "Mätning 7 as diameter at breast height in mm" in said
    assert f"not read: {tongue.headings[0]}, {tongue.headings[6]}" in said
    assert [stem.tree.radius_m for stem in read_stems(out).stems] == [0.0157, 0.023, 0.0091]
    assert [stem.id for stem in read_stems(out).stems] == ["1", "2", "3"], "the row names, which have no heading"


def test_a_mapped_column_wins_over_what_names_say(written: Any) -> None:
    file = written("lat,lon,x,y,dbh,D 2024\n47.0,8.0,1,2,99,30\n47.0,8.1,3,4,99,30\n")
    assert "has the place in more than one way" in says(file)
    command = ["forest", "import", str(file), "--out", str(file.with_name("out.csv"))]
    assert main([*command, "--column", "east_m=x", "--column", "north_m=y", "--column", "dbh_cm=D 2024"]) == EXIT_DONE
    stems = read_stems(file.with_name("out.csv"))
    assert [(tree.east_m, tree.radius_m) for tree in stems.trees] == [(1.0, 0.15), (3.0, 0.15)]


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("dbh_cm", "dbh_cm: must be NAME=HEADING"),
        ("girth_cm=x", "girth_cm=x: must be NAME=HEADING, with a name as east_m"),
        ("dbh_cm=D3", 'has no column "D3" (found: x, y, D1, D2)'),
    ],
)
def test_a_mapping_that_fits_no_column_is_refused(
    option: str, message: str, written: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written("x,y,D1,D2\n1,2,30,31\n")
    out = file.with_name("out.csv")
    assert main(["forest", "import", str(file), "--out", str(out), "--column", option]) == EXIT_BAD_FILE
    assert message in capsys.readouterr().err
    assert not out.exists()


def test_a_geometry_is_not_overruled_by_a_column(written: Any, capsys: pytest.CaptureFixture[str]) -> None:
    file = written("{}", "stems.geojson")
    command = ["forest", "import", str(file), "--out", str(file.with_name("out.csv")), "--column", "lat=y"]
    assert main(command) == EXIT_BAD_FILE
    assert "says by its geometry where trees stand" in capsys.readouterr().err


def test_numbers_that_may_be_two_are_refused_until_the_user_says_which(
    written: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written("x;y;dbh_mm\n1,234;2,345;301\n3,456;4,567;280\n5,678;6,789;250\n")
    out = file.with_name("out.csv")
    command = ["forest", "import", str(file), "--out", str(out)]
    assert main(command) == EXIT_BAD_FILE
    assert 'x = "1,234": with thousands or decimals? `mission forest import --decimal comma`' in capsys.readouterr().err
    assert main([*command, "--decimal", "comma"]) == EXIT_DONE
    assert [tree.east_m for tree in read_stems(out).trees] == [1.23, 3.46, 5.68]
    assert main([*command, "--decimal", "point"]) == EXIT_DONE
    assert [tree.east_m for tree in read_stems(out).trees] == [1234.0, 3456.0, 5678.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "X,Y,dbh\n8.00010,47.0,30\n8.00012,47.0001,31\n8.0002,47.0003,32\n",
            "of all trees are within 0.1: metres, or",
        ),
        ("X,Y,dbh\n500010.5,5205000,30\n", "`mission forest import --utm ZONE --column easting=X` if it is in a zone"),
        ("X,Y,C130 (cm)\n1,2,94\n", 'divide "C130 (cm)" by 3.1416: girths are not read'),
    ],
)
def test_what_would_be_taken_for_something_else_is_refused_with_what_to_do(
    text: str, message: str, written: Any
) -> None:
    assert any(message in str(problem) for problem in problems_of(written(text), lenient=True))


def test_a_first_line_that_tells_excel_its_separator_is_no_header(written: Any) -> None:
    (tree,) = read_stems(written("sep=;\r\nx;y;dbh_cm,old;dbh_cm\r\n1,5;2;3;30\r\n")).trees
    assert (tree.east_m, tree.radius_m) == (1.5, 0.15)


def test_ids_survive_each_format(written: Any) -> None:
    file = written("x,y,dbh_cm,tag\n1,2,30,A-1\n3,4,31,\n5,6,32,7\n")
    for name in ("out.csv", "out.geojson", "out.gpkg"):
        out = file.with_name(name)
        assert main(["forest", "import", str(file), "--out", str(out), "--origin", "47", "8"]) == EXIT_DONE
        assert [stem.id for stem in read_stems(out).stems] == ["A-1", "", "7"]
