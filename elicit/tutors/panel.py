"""A tutor made of several people's tutors: each question goes to the person whom it names."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

from elicit.model.comparator import Comparator
from elicit.model.comparator_parts import people_of
from elicit.model.query import Answer, Query
from elicit.model.tutor import KnowsLevels, answer_of, check_tutor_made


def as_one_tutor(
    tutor: Callable[[Query], Answer | int] | Mapping[str, Callable[[Query], Answer | int]],
    comparator: Comparator,
) -> Callable[[Query], Answer | int]:
    """Return one tutor for a mapping of tutors by name; a single tutor is returned as it is.

    It asks the person whom a query names. A comparator with several raters names nobody, and then
    the people are asked in turn.

    Raises
    ------
    ValueError
        If a person has no tutor, or there are several tutors but the comparator is of one person.
        It is raised before anybody is asked.
    """
    if not isinstance(tutor, Mapping):
        return tutor
    if getattr(comparator, "raters", False):
        return TutorsByTurns(tutor)
    people = people_of(comparator)
    if not {*people} <= {*tutor} or (not people and len(tutor) > 1):
        asked = ", ".join(map(repr, people)) or "one tutor alone, for there is no elicit.Panel"
        raise ValueError(
            f"the tutors are of {', '.join(map(repr, tutor))}, but the questions go to {asked}: "
            "give the tutor of each member of the panel by name, or, if all have one scale, a "
            "PosteriorComparator(k, raters=True)"
        )
    return PanelTutor(tutor)


class PanelTutor:
    """A tutor that passes each query to the tutor of the person that it names (``Query.who``).

    Parameters
    ----------
    tutors : mapping of str to tutor
        The tutor of each person. A tutor is any function from a ``Query`` to an ``Answer``, or to a
        verdict on the query's left vector. With a single tutor, a query need not name anybody.

    Raises
    ------
    TypeError
        If one of them cannot be called.
    ValueError
        If there is none, or they are for different numbers of levels.
    """

    def __init__(self, tutors: Mapping[str, Callable[[Query], Answer | int]]) -> None:
        if not tutors:
            raise ValueError("give at least one tutor, by the name of the person: {'ann': tutor}")
        levels = [tutor.k for tutor in tutors.values() if isinstance(tutor, KnowsLevels)]
        for tutor in tutors.values():
            check_tutor_made(tutor, levels[0] if levels else 0)
        self.tutors = MappingProxyType(dict(tutors))

    def __repr__(self) -> str:
        return f"PanelTutor({', '.join(self.tutors)})"

    def __call__(self, query: Query) -> Answer:
        """Return the answer of the person whom the query names, with that name.

        Parameters
        ----------
        query : Query
            With one tutor, it may leave out the name.

        Returns
        -------
        Answer

        Raises
        ------
        ValueError
            If the query names nobody, or a person without a tutor.
        """
        names = [*self.tutors]
        who = names[0] if query.who is None and len(names) == 1 else query.who
        if who is None or who not in self.tutors:
            asks = "asks nobody in particular" if who is None else f"asks {who!r}"
            raise ValueError(
                f"query {query.id} {asks}, but there are tutors for {', '.join(map(repr, names))}: "
                "give the tutor of each member of the elicit.Panel by name"
            )
        said = answer_of(self.tutors[who](query), query, who)
        return said if said.who is not None else replace(said, who=who)


class TutorsByTurns(PanelTutor):
    """A tutor that passes queries to several people in turn.

    A query that names somebody goes to that person.
    """

    def __init__(self, tutors: Mapping[str, Callable[[Query], Answer | int]]) -> None:
        super().__init__(tutors)
        self._asked = 0

    def __call__(self, query: Query) -> Answer:
        """Return the answer of the person whom the query names, else of the next in turn."""
        if query.who is None:
            names = [*self.tutors]
            query = replace(query, who=names[self._asked % len(names)])
            self._asked += 1
        return super().__call__(query)
