"""Which road words take: an encoder, a text-to-image back end, or the library of line drawings."""

from fabcraft.errors import InputError, MissingError
from fabcraft.guidance.drawing import Drawing
from fabcraft.recipe import Recipe

VIAS = {
    "clip": "an encoder of pictures and words, on renders of the object (the paper's text road)",
    "picture": "a text-to-image back end",
    "subjects": "the library of line drawings",
}
_NO_WEIGHTS = "no encoder's weights are on this machine"


def text_road(recipe: Recipe) -> tuple[str, str]:
    """(a key of `VIAS`, why) for the recipe's text: as asked, or the best that there is here.

    Raises `InputError` where two roads are asked for at once.
    """
    if recipe.encoder and recipe.via not in ("", "clip"):
        raise InputError(
            f"the encoder {recipe.encoder} was named, and --via {recipe.via} does not use one",
            "Leave --encoder out, or give --via clip.",
        )
    if recipe.via:
        return recipe.via, "as asked"
    if recipe.text_to_image:
        return "picture", "a text-to-image back end was named"
    if recipe.encoder:
        return "clip", "an encoder was named"
    if recipe.reading or recipe.frame or recipe.motif_mm:
        return "subjects", "a drawing has a place and a reading, an encoder shapes the whole object"
    return ("clip", "its weights are here") if _encoder_here() else ("subjects", _NO_WEIGHTS)


def _encoder_here() -> bool:
    from fabcraft.guidance.encoder_weights import cache_folder, cached

    if not any(cache_folder().glob("models--*")):
        return False  # without importing torch and open_clip to learn it
    from fabcraft.guidance.clip import DEFAULT, weights_of

    return cached(weights_of(DEFAULT)) is not None


def text_drawing(recipe: Recipe) -> tuple[Drawing, tuple[str, ...], tuple[str, ...]]:
    """(drawing, lines of the route, notes) of the recipe's text, by a road that leads through a drawing.

    Raises `InputError` for words that the library does not know, `MissingError` where the road's back end is not there.
    """
    via, why = text_road(recipe)
    if via == "picture":
        raise MissingError(
            "no text-to-image back end was named",
            "Name one (fabcraft backends): --text-to-image NAME; or take the library of drawings: --via subjects.",
        )
    from fabcraft.guidance.subjects.compose import composed
    from fabcraft.guidance.subjects.library import subjects
    from fabcraft.guidance.subjects.words import wish_of

    wish = wish_of(recipe.text, subjects())
    drawing = composed(wish, recipe.own.like or recipe.template, recipe.reading)
    line = f"text '{recipe.text.strip()}': {wish.words}, of {VIAS[via]} ({why})"
    return drawing, (line,), wish.notes
