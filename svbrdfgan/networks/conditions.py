"""Conditions of a layer that a generator can depend on, its amount and recipe, and the labels that stand for them."""

from __future__ import annotations

from dataclasses import dataclass

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.errors import ConfigError


@dataclass(frozen=True)
class Conditions:
    """The conditions that a data set's exemplars have. An amount or recipe that all of them share is no label.

    Attributes:
        amount: the least and the greatest amount; None if all exemplars have the same.
        recipes: all recipes; empty if they are not known.
    """

    amount: tuple[float, float] | None = None
    recipes: tuple[str, ...] = ()

    def untold(self) -> Conditions:
        """The conditions of a model without labels: the recipe is known if there is only one."""
        return Conditions(None, () if self._told_apart else self.recipes)

    def alike(self, other: Conditions) -> bool:
        """Whether labels of both say the same of a layer."""
        return (self.amount is None, self._told_apart) == (other.amount is None, other._told_apart)

    @property
    def size(self) -> int:
        """Numbers in the labels of a layer."""
        return (self.amount is not None) + len(self._told_apart)

    def labels(self, amount: float, recipe: str) -> list[float]:
        """The numbers that stand for the conditions: twice the amount less one, and 1 for the recipe among -1."""
        first = [] if self.amount is None else [2.0 * amount - 1.0]
        return first + [1.0 if known == recipe else -1.0 for known in self._told_apart]

    def choose(self, amount: float | None = None, recipe: str | None = None) -> list[float]:
        """The labels of a layer that a user wants.

        Args:
            amount: in [0, 1]; by default the middle of those that the exemplars have.
            recipe: one of several must be named.

        Raises:
            ConfigError: the amount is not in [0, 1], the recipe is not known, or nothing was learned of them.
        """
        if amount is not None and not 0.0 <= amount <= 1.0:
            raise ConfigError(f"amount {amount:g} is not allowed; wanted a number from 0 to 1.")
        if amount is not None and self.amount is None:
            raise ConfigError(
                "the model does not know amounts: leave out the amount, or train with generator.conditions on "
                "exemplars whose weathering.amount varies."
            )
        if recipe is not None and recipe not in self.recipes:
            hint = did_you_mean(recipe, self.recipes) or "."
            raise ConfigError(
                f"the model does not know the recipe {recipe!r}{hint} It knows {', '.join(self.recipes) or 'none'}."
            )
        if recipe is None and self._told_apart:
            raise ConfigError(f"the model knows the recipes {', '.join(self.recipes)}: name the one that is wanted.")
        if amount is None:
            amount = 0.0 if self.amount is None else sum(self.amount) / 2
        return self.labels(amount, recipe or "")

    def typical(self) -> list[float]:
        """The labels of a layer for scores of single layers: the middle amount of the first recipe."""
        return self.choose(recipe=self.recipes[0] if self.recipes else None)

    @property
    def _told_apart(self) -> tuple[str, ...]:
        return self.recipes if len(self.recipes) > 1 else ()
