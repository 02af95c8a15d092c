"""The answer of a command that uses a result, the same on its page and on the terminal."""

from dataclasses import dataclass
from typing import TypeAlias

from elastid.base.display import Display

# Each with its sentences.
Questions: TypeAlias = tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class Answer:
    """Title of the page, questions with their sentences, tables with their titles.

    notes: below the tables of the page alone.  text: to copy.
    """

    title: str
    questions: Questions
    tables: tuple[Display, ...] = ()
    notes: tuple[str, ...] = ()
    text: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentences of all questions."""
        return tuple(sentence for _, sentences in self.questions for sentence in sentences)
