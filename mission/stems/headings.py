"""Names in stem maps, in the eight languages that are read: of columns, and of the species that have curves.

Each is compared folded: lower case, without accents, all else than letters and digits as one `_`. So `Höhe`, `HÖHE` and
`hohe` are one name, and `hoehe` is another.
"""

from __future__ import annotations

import re
import unicodedata
from enum import StrEnum
from typing import Final

from mission.schema.trees import Species


class Meaning(StrEnum):
    """Quantity in a column; the value is how messages call it."""

    EAST = "east"
    NORTH = "north"
    LAT = "latitude"
    LON = "longitude"
    EASTING = "easting"
    NORTHING = "northing"
    DBH = "diameter at breast height"
    HEIGHT = "height"
    CROWN_BASE = "crown base"
    CROWN_RADIUS = "crown radius"
    SPECIES = "species"
    ID = "id"


_PLAIN: Final = re.compile(r"[^a-z0-9]+")
_LETTERS: Final = str.maketrans(
    {"ß": "ss", "ø": "o", "æ": "ae", "œ": "oe", "ł": "l", "đ": "d"}
)  # have no accent to drop


def folded(name: str) -> str:
    """`Höhe (m)` as `hohe_m`."""
    bare = unicodedata.normalize("NFKD", name.lower().translate(_LETTERS))
    return _PLAIN.sub("_", "".join(c for c in bare if not unicodedata.combining(c))).strip("_")


# A line for each language: English (and what programs write), German, French, Finnish, Swedish, Spanish, Portuguese,
# Polish. A name that means two things in two of them is left out (Swedish "längd" is a height or a longitude), and so
# is one that is no measure of the tree itself ("altitude").
_NAMES: Final = {
    Meaning.EAST: """
        east x x_local local_x dx x_coord coord_x x_coordinate coordx
        ost x_koordinate osten  est coordonnee_x  ita x_koordinaatti  ost_koordinat x_koordinat oster
        este coordenada_x  leste  wschod wspolrzedna_x""",
    Meaning.NORTH: """
        north y y_local local_y dy y_coord coord_y y_coordinate coordy
        nord y_koordinate norden  coordonnee_y  pohjoinen y_koordinaatti  nord_koordinat y_koordinat norr
        norte coordenada_y  polnoc wspolrzedna_y""",
    Meaning.LAT: """
        lat latitude lat_wgs84 latitude_wgs84  breite breitengrad geographische_breite  leveysaste leveyspiiri
        latitud breddgrad  szerokosc szerokosc_geograficzna szer_geogr""",
    Meaning.LON: """
        lon lng long longitude lon_wgs84 longitude_wgs84  laenge lange laengengrad langengrad geographische_lange
        pituusaste pituuspiiri  longitud langdgrad  dlugosc dlugosc_geograficzna dl_geogr""",
    Meaning.EASTING: """
        easting utm_e utm_east utm_x e_utm x_utm  rechtswert ostwert  ita_koordinaatti itakoordinaatti
        ostlig_koordinat""",
    Meaning.NORTHING: """
        northing utm_n utm_north utm_y n_utm y_utm  hochwert nordwert  pohjois_koordinaatti pohjoiskoordinaatti
        nordlig_koordinat""",
    Meaning.DBH: """
        dbh d d13 d130 d1_3 d_1_3 d1_30 diameter diam dbh_ob diameter_at_breast_height diameter_breast_height
        bhd durchmesser brusthohendurchmesser brusthoehendurchmesser
        dhp diametre diametre_hauteur_poitrine diametre_a_hauteur_de_poitrine diametre_a_1_30_m
        lapimitta rinnankorkeuslapimitta  brosthojdsdiameter  dap dn diametro diametro_normal diametro_a_1_30
        diametro_a_altura_do_peito diametro_a_la_altura_del_pecho  piersnica srednica""",
    Meaning.HEIGHT: """
        height h ht tree_height total_height height_total  hohe hoehe baumhohe baumhoehe
        hauteur hauteur_totale hauteur_arbre  pituus puun_pituus  hojd tradhojd
        altura altura_total altura_arbol altura_da_arvore  wysokosc wysokosc_drzewa""",
    Meaning.CROWN_BASE: """
        crown_base crown_base_height height_crown_base hcb height_to_crown_base
        kronenansatz kronenansatzhohe kronenansatzhoehe  base_du_houppier hauteur_base_houppier base_houppier
        latvusraja elavan_latvuksen_alaraja latvuksen_alaraja  krongrans krongranshojd kronbas
        altura_base_copa altura_de_la_base_de_la_copa base_de_copa  altura_da_base_da_copa base_da_copa
        podstawa_korony wysokosc_podstawy_korony""",
    Meaning.CROWN_RADIUS: """
        crown_radius  kronenradius  rayon_du_houppier rayon_houppier  latvuksen_sade  kronradie
        radio_copa radio_de_copa  raio_da_copa raio_copa  promien_korony""",
    Meaning.SPECIES: """
        species spp sp tree_species species_name scientific_name  baumart art  essence espece  puulaji
        tradslag tradart  especie  gatunek gatunek_drzewa""",
    Meaning.ID: """
        id tree_id treeid tree_no tree_nr tree_number stem_id stemid tag tree_tag
        baum_id baum_nr baumnr baumnummer nr nummer  id_arbre no_arbre n_arbre numero_arbre numero no
        puu_nro puu_id numero_puu
        trad_id tradnr trad_nr  id_arbol num_arbol  id_arvore num_arvore  nr_drzewa id_drzewa numer numer_drzewa""",
}
MEANINGS: Final = {name: meaning for meaning, names in _NAMES.items() for name in names.split()}
_ROUND: Final = """
    girth gbh cbh circumference umfang stammumfang circonference c130 c_130 circ ymparysmitta omkrets
    circunferencia cap perimetro obwod"""
GIRTHS: Final = frozenset(_ROUND.split())

_KINDS: Final = {
    Species.SPRUCE: """
        spruce fir picea abies pseudotsuga larix larch tsuga hemlock thuja cedar  fichte tanne douglasie larche laerche
        epicea sapin douglas meleze  kuusi lehtikuusi  gran lark  abeto alerce  swierk jodla modrzew""",
    Species.PINE: "pine pinus  kiefer fohre foehre  pin  manty  tall  pino  pinheiro  sosna",
    Species.BROADLEAF: """
        broadleaf beech fagus quercus oak betula birch acer maple fraxinus ash carpinus hornbeam alnus alder populus
        tilia lime  buche rotbuche eiche birke ahorn esche  hetre chene bouleau erable frene charme
        koivu tammi leppa haapa  bjork bok ek asp  haya roble encina abedul arce  faia carvalho betula
        buk dab brzoza klon jesion olsza""",
}
_GENERA: Final = {name: kind for kind, names in _KINDS.items() for name in names.split()}
_COMPOUND_MIN: Final = 5  # letters of a name that another word may end with


def species_of(word: str) -> Species | None:
    """The kind of a folded word of a tree's name: itself, or what it ends with, as Weißtanne and Stieleiche do."""
    if word in _GENERA:
        return _GENERA[word]
    ends = [name for name in _GENERA if len(name) >= _COMPOUND_MIN and word.endswith(name)]
    return _GENERA[max(ends, key=len)] if ends else None
