"""Named probability distributions of properties of people, and their random number generators."""

import hashlib
import math
import reprlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evac.base.arrays import FloatArray
from evac.base.errors import ScenarioError
from evac.base.parameters import did_you_mean

#: Names of the parameters of each distribution; see `Distribution`.
FAMILIES = {
    "constant": ("value",),
    "uniform": ("low", "high"),
    "normal": ("mean", "standard deviation"),
    "lognormal": ("mu", "sigma"),
    "weibull": ("shape", "scale"),
    "gamma": ("shape", "scale"),
    "list": ("values",),
}

#: Keys of the other form of ``lognormal``: mean and standard deviation of the value itself, not of its logarithm.
LOGNORMAL_TABLE = ("mean", "deviation")

LEAST_SHARE = 1e-6  #: Minimum probability between the bounds of a truncated distribution.


@dataclass(frozen=True)
class Distribution:
    """A probability distribution as given in case.toml, truncated to [minimum, maximum].

    Parameters
    ----------
    kind : str
        ``constant`` (value), ``uniform`` (low, high), ``normal`` (mean, standard deviation), ``lognormal``
        (mu and sigma of the logarithm of the value), ``weibull`` (shape, scale), ``gamma`` (shape, scale) or ``list``
        (values taken in order, one for each person; quantities of a group need exactly one for each).
    numbers : tuple of float
    minimum, maximum : float
        Bounds of the truncated distribution.
    """

    kind: str
    numbers: tuple[float, ...]
    minimum: float = -math.inf
    maximum: float = math.inf

    @classmethod
    def __get_pydantic_json_schema__(cls, *_: object) -> dict[str, Any]:
        """Return the JSON schema of what case.toml has: a number, or a table with one kind of distribution."""
        numbers = {"type": "array", "items": {"type": "number"}}
        moments: dict[str, Any] = {"type": "object", "properties": {key: {"type": "number"} for key in LOGNORMAL_TABLE}}
        moments |= {"required": list(LOGNORMAL_TABLE), "additionalProperties": False}
        kinds: dict[str, Any] = {name: {"description": ", ".join(words), **numbers} for name, words in FAMILIES.items()}
        kinds |= {"constant": {"anyOf": [{"type": "number"}, numbers]}, "lognormal": {"anyOf": [numbers, moments]}}
        kinds |= {key: {"type": "number"} for key in ("minimum", "maximum")}
        table = {"type": "object", "properties": kinds, "additionalProperties": False, "minProperties": 1}
        return {"anyOf": [{"type": "number"}, table]}

    def draw(self, generator: np.random.Generator, n: int) -> FloatArray:
        """Return `n` values, (n,) float64.

        A truncated distribution is sampled by inversion, which is equivalent to rejection sampling but needs exactly
        one random number per person, whatever the bounds.
        """
        if self.kind == "list":
            if len(self.numbers) < n:
                raise ScenarioError(f"a list of {len(self.numbers)} values for {n} people; give one for each person")
            return np.array(self.numbers[:n], dtype=np.float64)
        if self.kind == "constant":
            return np.full(n, self.numbers[0])
        low, high = self._shares()
        shares = generator.uniform(np.nextafter(low, 1.0), np.nextafter(high, 0.0), n)
        return np.asarray(self._law().quantile(shares), dtype=np.float64).clip(*self.support())

    def quantiles(self, shares: FloatArray) -> FloatArray:
        """Return the values (n,) that the shares (n,) of all values, from 0 to 1, do not exceed."""
        if self.kind in ("constant", "list"):
            return np.quantile(self.numbers, shares)
        low, high = self._shares()
        within = np.clip(low + shares * (high - low), np.nextafter(low, 1.0), np.nextafter(high, 0.0))
        return np.asarray(self._law().quantile(within), dtype=np.float64).clip(*self.support())

    def mean(self) -> float:
        """Return the mean, taking truncation into account."""
        if self.kind in ("constant", "list"):
            return math.fsum(self.numbers) / len(self.numbers)
        low, high = self._shares()
        return self._law().partial_mean(*self.support()) / (high - low)

    def support(self) -> tuple[float, float]:
        """Return the smallest and the largest possible value."""
        low, high = -math.inf, math.inf
        if self.kind in ("constant", "uniform", "list"):
            low, high = min(self.numbers), max(self.numbers)
        elif self.kind != "normal":
            low = 0.0
        return max(low, self.minimum), min(high, self.maximum)

    def is_positive(self) -> bool:
        """Return whether every value is greater than zero."""
        low, high = self.support()
        return low > 0 or (low == 0 and high > 0 and self.kind in ("lognormal", "weibull", "gamma"))

    def to_value(self) -> float | dict[str, Any]:
        """Return the distribution as written in case.toml."""
        if self.kind == "constant" and math.isinf(self.minimum) and math.isinf(self.maximum):
            return self.numbers[0]
        value: dict[str, Any] = {self.kind: self.numbers[0] if self.kind == "constant" else list(self.numbers)}
        if self.minimum > -math.inf:
            value["minimum"] = self.minimum
        if self.maximum < math.inf:
            value["maximum"] = self.maximum
        return value

    def _law(self) -> "_Law":
        return _LAWS[self.kind](*self.numbers)

    def _shares(self) -> tuple[float, float]:
        """Return the cumulative probabilities at both ends of the support."""
        low, high = self.support()
        law = self._law()
        return law.share(low), law.share(high)


@dataclass(frozen=True)
class _Law:
    """Cumulative distribution P(X <= x), its inverse, and the integral of x times the density from a to b."""

    share: Callable[[float], float]
    quantile: Callable[[FloatArray], FloatArray]
    partial_mean: Callable[[float, float], float]


def _uniform(low: float, high: float) -> _Law:
    width = high - low
    return _Law(
        share=lambda x: (x - low) / width,
        quantile=lambda u: low + width * u,
        partial_mean=lambda a, b: (b - a) * (a + b) / 2 / width,
    )


def _normal(mean: float, deviation: float) -> _Law:
    from scipy.special import ndtr, ndtri

    def density(x: float) -> float:
        return math.exp(-(((x - mean) / deviation) ** 2) / 2) / math.sqrt(2 * math.pi)

    def share(x: float) -> float:
        return float(ndtr((x - mean) / deviation))

    return _Law(
        share=share,
        quantile=lambda u: mean + deviation * ndtri(u),
        partial_mean=lambda a, b: mean * (share(b) - share(a)) + deviation * (density(a) - density(b)),
    )


def _lognormal(mu: float, sigma: float) -> _Law:
    normal = _normal(mu, sigma)
    tilted = _normal(mu + sigma**2, sigma)

    def log(x: float) -> float:
        return math.log(x) if x > 0 else -math.inf

    return _Law(
        share=lambda x: normal.share(log(x)),
        quantile=lambda u: np.exp(normal.quantile(u)),
        partial_mean=lambda a, b: math.exp(mu + sigma**2 / 2) * (tilted.share(log(b)) - tilted.share(log(a))),
    )


def _weibull(shape: float, scale: float) -> _Law:
    from scipy.special import gammainc

    def power(x: float) -> float:
        return float((x / scale) ** shape)

    return _Law(
        share=lambda x: -math.expm1(-power(x)),
        quantile=lambda u: scale * (-np.log1p(-u)) ** (1 / shape),
        partial_mean=lambda a, b: (
            scale
            * math.gamma(1 + 1 / shape)
            * float(gammainc(1 + 1 / shape, power(b)) - gammainc(1 + 1 / shape, power(a)))
        ),
    )


def _gamma(shape: float, scale: float) -> _Law:
    from scipy.special import gammainc, gammaincinv

    return _Law(
        share=lambda x: float(gammainc(shape, x / scale)),
        quantile=lambda u: scale * gammaincinv(shape, u),
        partial_mean=lambda a, b: (
            shape * scale * float(gammainc(shape + 1, b / scale) - gammainc(shape + 1, a / scale))
        ),
    )


_LAWS: dict[str, Callable[[float, float], _Law]] = {
    "uniform": _uniform,
    "normal": _normal,
    "lognormal": _lognormal,
    "weibull": _weibull,
    "gamma": _gamma,
}


def parse(
    value: object, key: str, *, minimum: float | None = None, above: float | None = None, maximum: float | None = None
) -> Distribution:
    """Parse a distribution as written in case.toml."""
    try:
        return distribution_from(value, minimum=minimum, above=above, maximum=maximum)
    except ValueError as error:
        raise ScenarioError(f"{key}: {error}") from error


def distribution_from(
    value: object, *, minimum: float | None = None, above: float | None = None, maximum: float | None = None
) -> Distribution:
    """Parse a distribution like `parse`, but raise ValueError without a key in the message."""
    distribution = _read(value)
    _check_bound(distribution, minimum, above)
    if maximum is not None:
        high, mean = distribution.support()[1], distribution.mean()
        if math.isfinite(high) and high > maximum:
            raise ValueError(f"must be at most {maximum:g}, got {high:g}")
        if mean > maximum:
            raise ValueError(f"must be at most {maximum:g}, but the mean of {distribution.kind} is {mean:g}")
    return distribution


def generator_for(seed: int, *names: str) -> np.random.Generator:
    """Return the generator of (seed, names), which is identical on every machine and independent of all others."""
    digest = hashlib.blake2b("\0".join(names).encode(), digest_size=16).digest()
    return np.random.default_rng(np.random.SeedSequence([seed, int.from_bytes(digest, "little")]))


#: Greatest values of the words of a generator's state.
MOST_WORDS = np.array([2**64 - 1] * 4 + [1, 2**32 - 1], dtype=np.uint64)


def generator_state(generator: np.random.Generator) -> NDArray[np.uint64]:
    """Return the state of a generator made by `generator_for` as an array."""
    state: Any = generator.bit_generator.state
    words = []
    for value in (state["state"]["state"], state["state"]["inc"]):
        words.extend([value >> 64, value & (2**64 - 1)])
    return np.array([*words, state["has_uint32"], state["uinteger"]], dtype=np.uint64)


def restore_generator(generator: np.random.Generator, words: NDArray[np.uint64]) -> None:
    """Restore a state that `generator_state` returned."""
    numbers = [int(word) for word in words]
    generator.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": numbers[0] << 64 | numbers[1], "inc": numbers[2] << 64 | numbers[3]},
        "has_uint32": numbers[4],
        "uinteger": numbers[5],
    }


def _read(value: object) -> Distribution:
    if isinstance(value, Distribution):
        return value
    if not isinstance(value, dict):
        return Distribution("constant", (_number("the value", value),))
    for name in value:
        if name not in (*FAMILIES, "minimum", "maximum"):
            raise ValueError(f"unknown distribution {name!r}; {did_you_mean(name, (*FAMILIES, 'minimum', 'maximum'))}")
    kinds = [name for name in value if name in FAMILIES]
    if len(kinds) != 1:
        raise ValueError(f"needs exactly one of {', '.join(FAMILIES)}; got {', '.join(kinds) or 'none'}")
    distribution = Distribution(
        kinds[0],
        _numbers(kinds[0], value[kinds[0]]),
        _number("minimum", value["minimum"]) if "minimum" in value else -math.inf,
        _number("maximum", value["maximum"]) if "maximum" in value else math.inf,
    )
    _check_shape(distribution)
    return distribution


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= sys.float_info.max:
        raise ValueError(f"{name} must be a finite number, got {reprlib.repr(value)}")
    return float(value)


def _numbers(kind: str, given: object) -> tuple[float, ...]:
    names = FAMILIES[kind]
    if kind == "constant":
        return (_number(kind, given),)
    if kind == "lognormal" and isinstance(given, dict):
        return _lognormal_of(given)
    if not isinstance(given, (list, tuple)):
        raise ValueError(f"{kind} = [{', '.join(names)}] expected, got {reprlib.repr(given)}")
    if kind == "list":
        if not given:
            raise ValueError("list must have at least one value")
        return tuple(_number(f"value {index} of list", item) for index, item in enumerate(given))
    if len(given) != len(names):
        raise ValueError(f"{kind} = [{', '.join(names)}] expected, got {len(given)} numbers")
    return tuple(_number(f"{name} of {kind}", item) for name, item in zip(names, given, strict=True))


def _lognormal_of(given: dict[str, object]) -> tuple[float, float]:
    """Return mu and sigma of a lognormal distribution given by its mean and standard deviation."""
    if set(given) != set(LOGNORMAL_TABLE):
        raise ValueError(f"lognormal = {{ mean = ..., deviation = ... }} or [mu, sigma] expected, got {given!r:.100}")
    mean, deviation = (_number(f"{name} of lognormal", given[name]) for name in LOGNORMAL_TABLE)
    for name, number in zip(LOGNORMAL_TABLE, (mean, deviation), strict=True):
        if number <= 0:
            raise ValueError(f"{name} of lognormal must be greater than 0, got {number:g}")
    ratio = deviation / mean
    variance = math.log1p(ratio * ratio)  # of the logarithm
    return math.log(mean) - 0.5 * variance, math.sqrt(variance)


def _check_shape(given: Distribution) -> None:
    """Refuse invalid parameters, and bounds that contain almost no probability."""
    names = FAMILIES[given.kind]
    positive = {"normal": (1,), "lognormal": (1,), "weibull": (0, 1), "gamma": (0, 1)}.get(given.kind, ())
    for index in positive:
        if given.numbers[index] <= 0:
            raise ValueError(f"{names[index]} of {given.kind} must be greater than 0, got {given.numbers[index]:g}")
    if given.kind == "uniform" and given.numbers[0] >= given.numbers[1]:
        raise ValueError(f"uniform = [low, high] needs low < high, got [{given.numbers[0]:g}, {given.numbers[1]:g}]")
    if given.minimum > given.maximum:
        raise ValueError(f"minimum {given.minimum:g} is greater than maximum {given.maximum:g}; swap them")
    if given.kind in ("constant", "list"):
        outside = [x for x in given.numbers if not given.minimum <= x <= given.maximum]
        if outside:
            raise ValueError(f"the value {outside[0]:g} is outside [{given.minimum:g}, {given.maximum:g}]; correct it")
        return
    low, high = given.support()
    try:
        is_empty = low >= high or given._shares()[1] - given._shares()[0] < LEAST_SHARE
        mean = 0.0 if is_empty else given.mean()
    except (OverflowError, ZeroDivisionError):
        mean = math.inf
    if not math.isfinite(mean):
        raise ValueError(f"the mean of {given.kind} = {list(given.numbers)} cannot be computed; correct the numbers")
    if is_empty:
        raise ValueError(
            f"the probability of {given.kind} in [{given.minimum:g}, {given.maximum:g}] is almost 0; widen the bounds"
        )


def _check_bound(given: Distribution, minimum: float | None, above: float | None) -> None:
    low, _ = given.support()
    if above is not None and not (low > above or (above == 0 and given.is_positive())):
        bound = f"greater than {above:g}"
    elif minimum is not None and low < minimum:
        bound = f"at least {minimum:g}"
    else:
        return
    if math.isinf(low):
        raise ValueError(f"must be {bound}, but {given.kind} has smaller values; add a minimum")
    raise ValueError(f"must be {bound}, got {low:g}")


def as_text(value: Any) -> str:
    """Return a value of a case as words: a distribution as its name and numbers."""
    if isinstance(value, Mapping):
        return "; ".join(_pair_as_text(key, item) for key, item in value.items()) or "-"
    if isinstance(value, list | tuple):
        listed = [as_text(item) for item in value]
        return ", ".join(listed if len(listed) <= 12 else [*listed[:3], "...", f"{len(listed)} values"]) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None:
        return "inf"  # JSON has no other word for it
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _pair_as_text(key: str, value: Any) -> str:
    if key == "uniform" and isinstance(value, list) and len(value) == 2:
        return f"uniform from {as_text(value[0])} to {as_text(value[1])}"
    return f"{key}: {as_text(value)}"
