"""Seeds on the command line."""

import argparse


def seed_range(text: str) -> range:
    """``100-109`` or ``100``; for argparse."""
    first, _, last = text.partition("-")
    try:
        seeds = range(int(first), int(last or first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a range of seeds like 100-109") from None
    if not seeds:
        raise argparse.ArgumentTypeError(f"{text!r} holds no seed; write the smaller one first")
    return seeds
