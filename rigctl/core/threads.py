"""Small matrices are slower on several threads than on one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

P = ParamSpec("P")
R = TypeVar("R")


def one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Keep the linear algebra of a call on one thread."""

    @wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> R:
        with _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return alone


@cache
def _controller(with_scipy: bool) -> ThreadpoolController:  # noqa: ARG001
    """Of what is loaded: looking through all libraries takes as long as a small comparison; scipy brings one more."""
    return ThreadpoolController()
