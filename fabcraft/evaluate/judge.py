"""Which encoder scores the objects, by what is on this machine."""

from fabcraft.errors import MissingError


def judge_of(encoder: str = "") -> str:
    """The encoder for the score: `encoder`, or one whose weights are here, rather not the one that the fit runs on; "" for
    none.

    Raises `InputError` for an encoder that is none.
    """
    from fabcraft.guidance.encoder_weights import cache_folder, cached

    if not encoder and not any(cache_folder().glob("models--*")):
        return ""  # without importing torch and open_clip to learn it
    from fabcraft.guidance.clip import DEFAULT, KNOWN, load_clip, weights_of

    if encoder:
        try:
            load_clip(encoder)
        except MissingError:
            return ""
        return encoder
    others = sorted(KNOWN, key=lambda name: name == DEFAULT)
    return next((name for name in others if cached(weights_of(name)) is not None), "")
