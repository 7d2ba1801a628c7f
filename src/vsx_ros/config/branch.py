"""What the branches of the configuration share."""

from typing import Annotated

from msgspec import Meta, Struct

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Ratio = Annotated[float, Meta(ge=0, le=1)]
Factor = Annotated[float, Meta(gt=0, le=1)]
Count = Annotated[int, Meta(ge=1)]


class Branch(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Common policy: immutable, unknown names refused, keyword only."""
