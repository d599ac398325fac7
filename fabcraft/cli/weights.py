"""`fabcraft weights list | fetch | path`: the encoders' weights, brought here before they are needed."""

from cyclopts import App

from fabcraft.cli.catalogue import PLAIN
from fabcraft.cli.console import result, result_json, say, table

weights = App("weights", help="List the encoders that compare pictures with words, or fetch their weights.")
weights.default_parameter, weights.help_epilogue, weights.sort_key = PLAIN, "", 13


@weights.default
@weights.command(name="list")
def list_weights(*, json: bool = False) -> int:
    """List the encoders, and which of them are on this machine.

    Parameters
    ----------
    json
        Print JSON.
    """
    from fabcraft.guidance.clip import KNOWN, weights_of
    from fabcraft.guidance.encoder_weights import cached

    wanted = [weights_of(name) for name in KNOWN]
    found = [(one, cached(one)) for one in wanted]
    if json:
        told = [
            {
                "name": one.name,
                "about": KNOWN[one.name],
                "repository": one.repository,
                "path": None if path is None else str(path),
            }
            for one, path in found
        ]
        result_json(told)
        return 0
    rows = [("name", "here", "about")]
    rows += [(one.name, "yes" if path else "no", KNOWN[one.name]) for one, path in found]
    terms = "The weights come from the Hugging Face Hub (--json names the repositories) under their makers' terms."
    result(f"{table(rows)}\n\n{terms}")
    return 0


@weights.command
def fetch(name: str | None = None, /) -> int:
    """Download an encoder's weights into the cache of the Hugging Face Hub.

    Parameters
    ----------
    name
        A name from `fabcraft weights`, or ARCHITECTURE/TAG of open_clip; the default encoder when left out.
    """
    from fabcraft.guidance.clip import DEFAULT, weights_of
    from fabcraft.guidance.encoder_weights import cached
    from fabcraft.guidance.encoder_weights import fetch as fetched

    wanted = weights_of(name or DEFAULT)
    path = cached(wanted)
    if path is None:
        say(f"fetching {wanted.name} from {wanted.repository}")
        path = fetched(wanted)
    else:
        say(f"{wanted.name} is already here")
    result(str(path))
    return 0


@weights.command(name="path")
def path_of(name: str | None = None, /) -> int:
    """Print where an encoder's weights lie, or the folder that holds them all.

    Parameters
    ----------
    name
        A name from `fabcraft weights`; the folder of all weights when left out.
    """
    from fabcraft.guidance.encoder_weights import cache_folder, require_cached

    if name is None:
        result(str(cache_folder()))
        return 0
    from fabcraft.guidance.clip import weights_of

    result(str(require_cached(weights_of(name))))
    return 0
