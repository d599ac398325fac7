"""Words become subjects of the library: "a mask that looks like a cute cat" is a cat.

A prompt falls into phrases at its connectives; a phrase's last words name the subject. Words for kinds of wearable, articles
and words such as "face" say nothing here; words before the subject are left aside, and told. A slip of the pen is read as
what was meant only where nothing else could be meant. Everything else is refused with the nearest subjects: no guessing.
"""

import difflib
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from fabcraft.errors import InputError
from fabcraft.guidance.subjects.library import Subject

MOST_LETTERS, NEAREST = 300, 5
CATEGORIES = {
    "mask", "masks", "ring", "rings", "bangle", "bangles", "bracelet", "bracelets", "cuff", "necklace", "necklaces",
    "pendant", "pendants", "glasses", "eyeglasses", "sunglasses", "spectacles", "frames", "visor", "visors",
    "helmet", "helmets", "slipper", "slippers", "wearable", "jewel", "jewelry", "jewellery", "accessory",
}  # fmt: skip
"""Words for what is made, not for what it looks like."""
FILLERS = {
    "a", "an", "the", "my", "your", "his", "her", "our", "their", "this", "that", "some", "one", "please", "me",
    "want", "i", "would", "give", "make", "it", "is",
}  # fmt: skip
GENERAL = {
    "face", "faces", "head", "heads", "shape", "shapes", "symbol", "sign", "icon", "design", "motif", "pattern",
    "theme", "themed", "style", "silhouette", "drawing", "picture", "sketch", "image", "figure", "character",
    "animal", "outline",
}  # fmt: skip
"""Words behind a subject that say no more than the subject does."""
BREAKS = {
    "looks", "look", "looking", "like", "resembling", "resembles", "shaped", "form", "as", "of", "in", "which",
    "for", "showing", "depicting",
}  # fmt: skip
JOINS: Mapping[str, Literal["with", "on", "and"]] = {
    "with": "with", "wearing": "with", "holding": "with", "has": "with", "having": "with", "on": "on", "over": "on",
    "and": "and", "plus": "and", "beside": "and", "next": "and",
}  # fmt: skip
REFUSED = {
    **dict.fromkeys(("no", "not", "without", "except", "minus", "never"), "what should not be there cannot be drawn"),
    **dict.fromkeys(("or", "either"), "one thing is made at a time"),
}  # fmt: skip
OTHERS = {"hot dog", "sea lion", "sea cow", "guinea pig", "prairie dog", "bull dog", "bird house", "dog house",
          "house boat", "sea urchin", "lady finger", "snow ball", "fire fly", "egg plant", "ant eater"}  # fmt: skip
"""Two words that mean something else than the second."""


@dataclass(frozen=True)
class Wish:
    """What a prompt asks for."""

    subject: Subject
    other: Subject | None = None
    how: Literal["", "with", "and"] = ""
    """The other one is a detail on the subject ("with"), or stands beside it ("and")."""
    notes: tuple[str, ...] = ()
    """What was read into the words or left aside, a sentence each."""

    @property
    def words(self) -> str:
        return self.subject.name + (f" {self.how} {self.other.name}" if self.other else "")


def wish_of(prompt: str, known: Mapping[str, Subject]) -> Wish:
    """What `prompt` asks for, of the `known` subjects by name.

    Raises `InputError`, with the nearest subjects, for what names none of them, more than two, or leaves a doubt.
    """
    if len(prompt) > MOST_LETTERS:
        raise InputError(
            f"the text has {len(prompt)} letters; at most {MOST_LETTERS} were expected",
            "Say it in a few words.",
        )
    phrases: list[tuple[str, list[str]]] = [("", [])]
    for word in plain(prompt).split():
        if word in REFUSED:
            raise InputError(f"the text says '{word}': {REFUSED[word]}", "Name what it should look like.")
        if word in JOINS or word in BREAKS:
            phrases.append((JOINS.get(word, ""), []))
        elif word not in FILLERS:
            phrases[-1][1].append(word)
    index = _index(known)
    found: list[tuple[str, Subject]] = []
    notes: list[str] = []
    join = ""
    for how, words in phrases:
        join = how or join
        subject = _subject(words, index, notes)
        if subject is not None:
            found.append((join if found else "", subject))
            join = ""
        elif how == "with" and found and words:
            raise InputError(
                f"'{' '.join(words)}' is a kind of wearable; the library draws what one looks like",
                _list_them(),
            )
    if not found:
        raise InputError(f"the text '{prompt.strip()[:60]}' names nothing to draw", _list_them())
    if len(found) > 2:
        names = ", ".join(subject.name for _, subject in found)
        raise InputError(
            f"the text names {len(found)} subjects ({names}); two at most are composed", "Name fewer."
        )
    (_, first), (how, second) = found[0], found[-1]
    if len(found) == 1:
        return Wish(first, notes=tuple(notes))
    if first is second:
        raise InputError(f"the text names the {first.name} twice", "Name it once.")
    if how == "on":
        first, second, how = second, first, "with"
    if how not in ("with", "and"):
        raise InputError(
            f"the text names {first.name} and {second.name}, but not how they belong together",
            f"Say '{first.name} with {second.name}' or '{first.name} and {second.name}'.",
        )
    return Wish(first, second, "with" if how == "with" else "and", tuple(notes))


def plain(text: str) -> str:
    """Lower case, no accents, nothing but letters, digits and single spaces."""
    bare = unicodedata.normalize("NFKD", text.lower().replace("&", " and "))
    bare = "".join(one for one in bare if not unicodedata.combining(one))
    bare = re.sub(r"['’]s\b", " ", bare)
    return " ".join(re.sub(r"[^a-z0-9]+", " ", bare).split())


def nearest(word: str, known: Mapping[str, Subject]) -> list[str]:
    """The subjects that are written most like `word`, the likest first, a synonym in brackets."""
    return _nearest(plain(word), _index(known))


def _nearest(word: str, index: Mapping[str, Subject]) -> list[str]:
    found: dict[str, str] = {}
    for one in difflib.get_close_matches(word, index, n=4 * NEAREST, cutoff=0.6):
        name = index[one].name
        spaced = next((word for word in index[one].words if plain(word).replace(" ", "") == one), one)
        alike = plain(name).replace(" ", "") == one.replace(" ", "")
        found.setdefault(name, name if alike else f"{name} ({spaced})")
    return list(found.values())[:NEAREST]


def _index(known: Mapping[str, Subject]) -> dict[str, Subject]:
    """Every way to write a subject; names go before other words."""
    index: dict[str, Subject] = {}
    for names in (lambda one: [one.name], lambda one: one.words):
        for subject in known.values():
            for name in names(subject):
                index.setdefault(plain(name), subject)
                index.setdefault(plain(name).replace(" ", ""), subject)
    return index


def _subject(words: list[str], index: Mapping[str, Subject], notes: list[str]) -> Subject | None:
    """The subject that a phrase ends with; None where it only says what is made."""
    rest = list(words)
    while rest:
        for count in range(min(4, len(rest)), 0, -1):
            if subject := _exactly(rest[-count:], index):
                _require_no_other(rest[:-count], rest[-count:], index)
                _left_aside(rest[:-count], notes)
                return subject
        if rest[-1] in CATEGORIES or rest[-1] in GENERAL:
            rest.pop()
            continue
        if meant := _meant(rest[-1], index):
            _require_no_other(rest[:-1], rest[-1:], index)
            notes.append(f"'{rest[-1]}' was read as {meant.name}.")
            _left_aside(rest[:-1], notes)
            return meant
        raise _unknown(rest, index)
    return None


def _exactly(words: list[str], index: Mapping[str, Subject]) -> Subject | None:
    for last in (words[-1], *_singulars(words[-1])):
        for written in (" ".join([*words[:-1], last]), "".join([*words[:-1], last])):
            if written in index:
                return index[written]
    return None


def _singulars(word: str) -> list[str]:
    """What `word` may be the plural of."""
    found = []
    for end, one in (("ies", "y"), ("ves", "f"), ("ves", "fe"), ("es", ""), ("s", "")):
        if word.endswith(end) and len(word) > len(end) + 2:
            found.append(word.removesuffix(end) + one)
    return found


def _meant(word: str, index: Mapping[str, Subject]) -> Subject | None:
    """The one subject that a misspelt word can only stand for."""
    slips: dict[str, tuple[int, Subject]] = {}
    for one in (word, *_singulars(word)):
        for name, subject in index.items():
            if " " not in name and name[0] == one[0] and (count := _slips(one, name)):
                best = slips.get(subject.name, (9, subject))
                slips[subject.name] = min(best, (count, subject), key=lambda pair: pair[0])
    least = min((count for count, _ in slips.values()), default=0)
    best_ones = [subject for count, subject in slips.values() if count == least]
    return best_ones[0] if len(best_ones) == 1 else None


def _slips(word: str, name: str) -> int:
    """How many slips of the pen lie between two words, 0 where it is too many to be sure.

    Letters that changed places, doubled or undoubled, are slips in any word of four letters and more; another letter,
    one too many or too few only in one of seven on, two only in one of nine on: short words have real words beside them.
    """
    short = min(len(word), len(name))
    if short < 3 or abs(len(word) - len(name)) > 2:
        return 0
    steps = _distance(word, name)
    undoubled = re.sub(r"(.)\1+", r"\1", word) == re.sub(r"(.)\1+", r"\1", name)
    swapped = len(word) == len(name) and sorted(word) == sorted(name)
    if steps == 1 and (undoubled or (swapped and short >= 4) or short >= 7):
        return 1
    return 2 if steps == 2 and short >= 9 else 0


def _distance(a: str, b: str) -> int:
    """Letters put in, left out, changed or swapped with their neighbour (optimal string alignment)."""
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i in range(1, len(a) + 1):
        last, row, older = row, [i], before
        for j in range(1, len(b) + 1):
            cost = min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] != b[j - 1]))
            if i > 1 and j > 1 and a[i - 1] == b[j - 2] and a[i - 2] == b[j - 1]:
                cost = min(cost, older[j - 2] + 1)
            row.append(cost)
        before = last
    return row[-1]


def _require_no_other(before: list[str], words: list[str], index: Mapping[str, Subject]) -> None:
    """Raise `InputError` for two nouns in a row: a tiger shark is no shark with stripes."""
    if before and f"{before[-1]} {words[0]}" in OTHERS:
        raise _unknown([before[-1], *words], index)
    subject = _exactly(words, index)
    for word in before:
        other = None if word in CATEGORIES else _exactly([word], index)
        if other is not None and other is not subject:
            raise InputError(
                f"'{' '.join([*before, *words])}' names {other.name} and {' '.join(words)} without saying how they "
                "belong together",
                f"Say '{' '.join(words)} with {other.name}', or one of them.",
            )


def _left_aside(before: list[str], notes: list[str]) -> None:
    if words := [word for word in before if word not in CATEGORIES and word not in GENERAL]:
        notes.append(f"Left aside, for the drawing cannot show it: {' '.join(words)}.")


def _unknown(words: list[str], index: Mapping[str, Subject]) -> InputError:
    close = _nearest(" ".join(words), index) + _nearest(words[-1], index)
    names = list({name.split(" (")[0]: name for name in reversed(close)}.values())[::-1][:NEAREST]
    near = f"Nearest: {', '.join(names)}. " if names else ""
    return InputError(f"there is no drawing of '{' '.join(words)}' in the library", near + _list_them())


def _list_them() -> str:
    return "All there are: fabcraft subjects."
