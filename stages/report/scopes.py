"""Scopes as tables, figures and pages order and call them. Files have a scope's name, pages its
title.
"""

#: The title of each scope of ``isi.evaluation.scopes``, in the order of tables.
TITLES = {
    "known": "earlier knowledge",
    "novel": "novel entities",
    "weighted": "weighted",
    "held_out": "held-out triples",
    "novel_held_out": "novel entities, held-out triples",
    "known_closed": "earlier knowledge, known candidates only",
}
#: Role of the novel entity in a query of scope ``novel``, with its title.
DIRECTIONS = {"given": "novel entity given", "answer": "novel entity is the answer"}
#: Scopes of the paper's measure, in the order of tables.
GROUPED = ("weighted", "known", "novel")
#: Scopes of earlier knowledge: with the novel entities among the candidates, and without.
EARLIER = ("known", "known_closed")
