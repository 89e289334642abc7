"""Scopes: groups of queries by code, with their titles."""

#: Titles of scopes. Known: test triples between known entities. Novel: every triple with a novel
#: entity, a training triple as often as it was observed. Weighted: both, by numbers of triples.
#: Held out: the test triples of D¹; of novel entities, their validation and test triples.
SCOPES = {
    "known": "earlier knowledge",
    "novel": "novel entities",
    "weighted": "weighted",
    "held_out": "held-out triples",
    "novel_held_out": "novel entities, held-out triples",
    "known_closed": "earlier knowledge, known candidates only",
}
GROUPS = ("known", "novel")  #: Scopes in which a run has to converge, at one epoch.
