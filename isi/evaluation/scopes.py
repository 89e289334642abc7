"""Scopes: groups of queries, by name."""

#: Known: test triples between known entities; known_closed: with known candidates only.
#: Novel: every triple with a novel entity, a training triple as often as it was observed.
#: Weighted: known and novel, by numbers of triples.
#: Held out: the test triples of D¹; novel_held_out: of novel entities, validation and test triples.
SCOPES = ("known", "novel", "weighted", "held_out", "novel_held_out", "known_closed")
GROUPS = ("known", "novel")  #: Scopes in which a run has to converge, at one epoch.
