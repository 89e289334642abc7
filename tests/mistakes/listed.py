"""Invalid tables, triples, word vectors, and files of Matterport3D and BEHAVIOR-1K."""

import gzip

from tests.fuzz.formats import BINARY, GLOVE, HOUSE, NT
from tests.mistakes import LOG, LONG, Case, changed, entities, log, of_file, vectors

SHARES, CATEGORIES = "data/raw/suncg/material_shares.csv", "data/raw/suncg/categories.csv"
TALLIES, TRIPLES = "data/raw/mp3d/room_object_counts.csv", "data/raw/published/triples.csv"
VOCABULARY = "data/raw/mp3d/vocabulary.yaml"
SCENES, MAPPED = "behavior/combined_room_object_list.json", "behavior/category_mapping.csv"
of_rdf, of_triples = (
    of_file("RDF, N-Triples", "log.nt"),
    of_file("triples with ids", "ids/gt2id.txt"),
)
of_names, of_behavior = (
    of_file("triples with ids", "ids/entity2id.txt"),
    of_file("BEHAVIOR", SCENES),
)

TABLE_CASES = [
    Case("no file", "table, CSV", {"log.csv": None}, "log.csv", {"entities": None}),
    Case(
        "a name that tells no form",
        "table, CSV",
        {"log.dat": "x"},
        "log.dat",
        {"path": "log.dat", "entities": None},
    ),
    log("a column that is missing", "head,tail\na,b\n", "line 1"),
    log("a field too many", LOG + "mug,atLocation,kitchen,\n", "line 3"),
    log("text in another encoding", LOG + "caf\udce9,atLocation,kitchen\n", "line 3|UTF-8"),
    log("a quote without an end", LOG + '"mug,atLocation,kitchen\n', "line 3"),
    log("a blank name", LOG + ",atLocation,kitchen\n", "line 3"),
    log("a name of 10,000 characters", LOG + f"{LONG},atLocation,kitchen\n", "line 3"),
    log("a name with a control character", LOG + "a\x1b[2J,atLocation,kitchen\n", "line 3"),
    log("a count that is no number", "head,relation,tail,count\na,b,c,many\n", "line 2"),
    log(
        "a count of 5,000 digits", "head,relation,tail,count\na,b,c," + "9" * 5_000 + "\n", "line 2"
    ),
    log("a count of none", "head,relation,tail,count\na,b,c,0\n", "line 2"),
    log("a count that is too large", "head,relation,tail,count\na,b,c,3000000000\n", "line 2"),
    log(
        "counts that are too large together",
        "head,relation,tail,count\n" + "a,b,c,1000000000\n" * 2,
        "1,000,000,000",
    ),
    log("no triples", "head,relation,tail\n", ""),
    log("a column twice", "head,relation,tail,tail\n", "line 1"),
    log("a line end in a name", 'head,relation,tail\n"a\nb",b,c\n', "line 2"),
    Case(
        "a compressed file that is cut short",
        "table, TSV",
        {"log.tsv.gz": gzip.compress(LOG.encode())[:-9]},
        "log.tsv.gz",
    ),
    Case(
        "a Parquet file that is none",
        "table, Parquet",
        {"log.parquet": b"PAR1 and so on"},
        "log.parquet",
    ),
    entities("an entity twice", "mug,object,cup\n", "entities.csv|line 7"),
    entities("an entity without a name", ",object,cup\n", "entities.csv|line 7"),
    Case(
        "an entity without a kind",
        "table, CSV",
        {"entities.csv": "entity,kind\nmug,object\n"},
        "entity 'bowl'",
    ),
    Case(
        "a relation that no home has",
        "table, CSV",
        {"log.csv": "head,relation,tail\na,near,b\n"},
        "relation 'near'",
        {"entities": None, "household": True},
    ),
    Case(
        "kinds of a relation that is not there",
        "table, CSV",
        {},
        "kinds|relation 'near'",
        {"kinds": {"near": {"head": "thing", "tail": "thing"}}},
    ),
    Case(
        "kinds that two relations give",
        "table, CSV",
        {"log.csv": LOG + "kitchen,near,mug\n"},
        "entity 'mug'",
        {
            "entities": None,
            "kinds": {
                "atLocation": {"head": "thing", "tail": "place"},
                "near": {"head": "place", "tail": "place"},
            },
        },
    ),
    Case(
        "kinds beside those of homes",
        "table, CSV",
        {},
        "kinds",
        {"household": True, "kinds": {"near": {"head": "thing", "tail": "thing"}}},
    ),
    Case(
        "an entity of two kinds",
        "table, CSV",
        {"log.csv": LOG + "mug,hasMaterial,clay\nbowl,hasMaterial,mug\n"},
        "entity 'mug'",
        {"entities": None, "household": True},
    ),
]

RDF_CASES = [
    Case("a name that tells no form", "RDF, Turtle", {}, "log.rdf", {"path": "log.rdf"}),
    of_rdf("no file", None),
    Case(
        "no compressed file",
        "RDF, Turtle",
        {"log.ttl.gz": "<a:b>"},
        "log.ttl.gz",
        {"path": "log.ttl.gz"},
    ),
    of_rdf("a line that is no triple", NT + "mug atLocation kitchen\n", "line 7"),
    Case("Turtle that is none", "RDF, Turtle", {"log.ttl": "<a:b> <a:c> [.\n"}, "log.ttl|line 1"),
    of_rdf("a letter that there is not", "<urn:a:\\UFFFFFFFF> <urn:a:c> <urn:a:d> .\n", "line 1"),
    of_rdf("no triple between things", '<urn:a:b> <urn:a:c> "d" .\n'),
    of_rdf("two things of one name", NT + "<urn:x:mug> <urn:x:near> <urn:x:bowl> .\n", "line 7"),
    of_rdf("a thing without a name", NT + "<http://x.org/> <urn:x:near> <urn:x:%20> .\n", "line 7"),
]


def house(what: str, old: str, new: str, line: int) -> Case:
    """A case with a mistake in a line of a house of Matterport3D; ``new`` replaces ``old``."""
    return changed(
        what, "houses of Matterport3D", "houses/x.house", old, new, f"houses/x.house|line {line}"
    )


MP3D_CASES = [
    Case("no houses", "houses of Matterport3D", {"houses/x.house": None}, "houses"),
    Case(
        "another format",
        "houses of Matterport3D",
        {"houses/x.house": "ASCII 2.0\n"},
        "houses/x.house|line 1",
    ),
    Case(
        "cut short",
        "houses of Matterport3D",
        {"houses/x.house": HOUSE[:-60]},
        "houses/x.house|line 2",
    ),
    Case(
        "no header",
        "houses of Matterport3D",
        {"houses/x.house": "ASCII 1.1\n"},
        "houses/x.house|line 2",
    ),
    house("a record of no known kind", "L 0", f"{LONG} 0", 3),
    house("a number of 5,000 digits", "O 0 0", f"O {'9' * 5000} 0", 8),
    house("too few fields", "C 1 10 towel 11 towel 0 0 0 0 0", "C 1", 7),
    house("a region that is not there", "O 1 1 1", "O 1 7 1", 9),
    house("a category of 10,000 characters", "11 towel", f"11 {LONG}", 9),
    house("a category without words", "11 towel", "11 #", 9),
    house("an object twice", "O 1 1 1", "O 0 1 1", 9),
    Case(
        "a house twice",
        "houses of Matterport3D",
        {"houses/y.house": HOUSE},
        "houses/y.house|house '17DRP5sb8fy'",
    ),
    changed(
        "a count of 20 digits",
        "tallies of Matterport3D",
        TALLIES,
        "bathroom,2",
        "bathroom," + "9" * 20,
        "",
    ),
    changed(
        "a blank object",
        "tallies of Matterport3D",
        TALLIES,
        "air conditioner,bathroom",
        ",bathroom",
        "",
    ),
    changed(
        "a tally twice",
        "tallies of Matterport3D",
        TALLIES,
        "air conditioner,bathroom",
        "air conditioner,balcony",
        "'air conditioner'",
    ),
    Case(
        "a vocabulary that is no YAML",
        "tallies of Matterport3D",
        {VOCABULARY: "structure: [\n"},
        f"{VOCABULARY}|line 2",
    ),
    Case(
        "a room that the tallies lack",
        "tallies of Matterport3D",
        {},
        "'cave'",
        {"rooms": {"cave": "kitchen"}},
    ),
]

SHIPPED_CASES = [
    changed(
        "a comma at the end of a line",
        "shares of materials",
        CATEGORIES,
        "arm chair,chair",
        "arm chair,chair,",
        "",
    ),
    changed("a share that is none", "shares of materials", SHARES, "0.731", "1.731", "'1.731'"),
    changed(
        "a share twice",
        "shares of materials",
        SHARES,
        "bathtub,metal",
        "bathtub,wood",
        "'bathtub wood'",
    ),
    changed(
        "a category without shares",
        "shares of materials",
        CATEGORIES,
        "arm chair,chair",
        "arm chair,boat",
        "'boat'",
    ),
    changed(
        "a triple twice",
        "published graph",
        TRIPLES,
        "alarm_clock.n.01,atLocation,table.l.02,1",
        "alarm_clock.n.01,atLocation,bedroom.l.01,1",
        "",
    ),
    changed(
        "a synset of no entity",
        "published graph",
        TRIPLES,
        "bedroom.l.01,30",
        "cave.l.01,30",
        "'cave.l.01'",
    ),
    changed(
        "a count that is no number",
        "shipped graph",
        "data/raw/thor_u/triples.csv",
        ",1,",
        ",many,",
        "data/raw/thor_u/triples.csv|line 2",
    ),
]

ID_CASES = [
    of_triples("no file", None),
    of_triples("fewer lines than it says", "3\n0 1 0\n", "line 1"),
    of_triples("a line that is no triple", "1\n0 1\n", "line 2"),
    of_triples("an id without a name", "1\n0 9 0\n", "line 2"),
    of_names("a name without an id", "1\nmug\n", "line 2"),
    of_names("a blank name", "1\n \t0\n", "line 2"),
    of_names("an id twice", "2\na\t0\nb\t0\n", "line 3"),
    of_names("an id left out", "2\na\t0\nb\t2\n"),
    Case("no triples", "triples with ids", {"ids/gt2id.txt": "0\n"}, "ids|gt2id.txt"),
]

BEHAVIOR_CASES = [
    of_behavior("no file", None),
    of_behavior("no JSON", "{"),
    of_behavior(
        "a large count",
        '{"scenes": {"a": {"b_0": {"stove-abcdef": 3000000000}}}}',
        "a.b_0.stove-abcdef",
    ),
    of_behavior(
        "a scene that is no name",
        '{"scenes": {"a b": {"kitchen_0": {"stove-abcdef": 1}}}}',
        "'a b'",
    ),
    of_behavior(
        "a room without a number",
        '{"scenes": {"a": {"kitchen": {"stove-abcdef": 1}}}}',
        "'kitchen'",
    ),
    of_behavior(
        "a model without a category", '{"scenes": {"a": {"kitchen_0": {"stove": 1}}}}', "'stove'"
    ),
    of_behavior(
        "a category without a synset",
        '{"scenes": {"a": {"b_0": {"boat-abcdef": 1}}}}',
        "'boat-abcdef'",
    ),
    changed("a category twice", "BEHAVIOR", MAPPED, "3,walls,", "3,stove,", "'stove'"),
    Case(
        "a setting of what is not there",
        "BEHAVIOR",
        {},
        "'boat.n.01'",
        {"structure": ["boat.n.01"]},
    ),
    Case(
        "an action that is no name",
        "BEHAVIOR",
        {},
        "affordances",
        {"affordances": {"openable": ["\topen"]}},
    ),
    Case("a name of nothing", "BEHAVIOR", {}, "stov.n.01", {"names": {"stov.n.01": "stove"}}),
    Case(
        "a name that is none",
        "BEHAVIOR",
        {},
        "names.stove.n.01",
        {"names": {"stove.n.01": "sto\tve"}},
    ),
    Case(
        "two synsets of one name", "BEHAVIOR", {}, "'stove'", {"names": {"cabinet.n.01": "stove"}}
    ),
]

WORD_CASES = [
    vectors("no vectors", b"", ""),
    vectors("no text", b"\xff\xfe1 2\n", ""),
    vectors("a line cut in the middle", GLOVE[:-9], "line 3"),
    vectors("a number cut in the middle", GLOVE[:-2], "line 3|line end"),
    vectors("what is no number", GLOVE + b"bowl 1 x 2\n", "'x'"),
    vectors("too many numbers", b"3 3\n" + GLOVE.replace(b" 0.1", b" 0.1 4"), "line 2"),
    vectors("a number behind the token", GLOVE + b". 1 2 3 4\n", "line 4"),
    vectors("two spaces", GLOVE + b"bowl  1 2 3\n", "line 4"),
    vectors("no token", GLOVE + b" 1 2 3\n", "line 4"),
    vectors("a header of three words, and one", b"3 3\nmug 1 2 3\n", "line 1"),
    vectors("a header of a dimension of none", b"3 0\nmug\n", "line 2"),
    vectors("numbers of 10¹⁷", GLOVE + b"bowl 1e17 1 1\n", "vector of 'bowl'"),
    vectors("what is not a number (NaN)", GLOVE + b"bowl nan 1 1\n", "vector of 'bowl'"),
    vectors("binary, cut short", BINARY[:-6], "unexpected end", binary=True),
    vectors("binary, of another dimension", BINARY.replace(b"3 3\n", b"3 2\n"), "", binary=True),
    Case("no file of vectors", "words", {"words.txt": None}, "words.txt"),
]
