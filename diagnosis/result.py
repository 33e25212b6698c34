"""What is found for one record: hypotheses with their fits and evidence, and the verdict."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from diagnosis.effects import Effect
from diagnosis.fit import Fitted
from diagnosis.inlet import RECORDED
from diagnosis.measured import Measured
from diagnosis.predictive import Predicted
from diagnosis.verdict import UNKNOWN, Hypothesis, Judgement


class Diagnosis(NamedTuple):
    """The diagnosis of one record; `study` writes it as a report.

    Attributes:
        record: the record.
        effects: the catalogue.
        judgement: probabilities and verdict.
        fits: every fitted hypothesis, each effect in its likeliest form.
        acting: the effects of every fitted hypothesis in those forms.
        forms: probabilities of the forms of every effect that has several, by id and name; the
            first form's name is empty.
        log_B: ln evidence of every fitted hypothesis over that of no gap.
        scan: ln B of every effect by the score scan about the base optimum.
        visibility: detectability λ of each effect in this record, per unit of its size.
        forcing: ln B of a free forcing alone, places × correlations × lengths × amplitudes.
        accompanied: the same together with other hypotheses, over no gap.
        beside: parts of the probability of "unknown", by the effects that act together with it.
        n_data: number of data.
        predicted: gain of the best hypothesis over no gap in ln predictive density.
        own: the record with the free inlet about which hypotheses with the recorded aortic waveform
            were fitted, see `own_inlet`; None where there are none.
    """

    record: Measured
    effects: tuple[Effect, ...]
    judgement: Judgement
    fits: Mapping[Hypothesis, Fitted]
    acting: Mapping[Hypothesis, tuple[Effect, ...]]
    forms: Mapping[str, Mapping[str, float]]
    log_B: Mapping[Hypothesis, float]
    scan: Mapping[str, float]
    visibility: Mapping[str, float]
    forcing: Float[np.ndarray, "p s l a"]
    accompanied: Mapping[Hypothesis, Float[np.ndarray, "p s l a"]]
    beside: Mapping[Hypothesis, float]
    n_data: int
    predicted: Predicted | None = None
    own: Measured | None = None

    @property
    def base(self) -> Fitted:
        """The fit without any effect."""
        return self.fits[()]

    @property
    def known_part(self) -> Hypothesis:
        """Effects that act beside something unknown, more likely than not; empty without any."""
        likeliest = max(self.beside, key=lambda h: self.beside[h])
        return likeliest if self.beside[likeliest] >= UNKNOWN else ()

    @property
    def best(self) -> Fitted:
        """The fit of the most probable hypothesis."""
        return self.fits[self.judgement.best]

    def fitted_about(self, hypothesis: Hypothesis) -> tuple[Measured, tuple[Effect, ...]]:
        """The record that a hypothesis was fitted to, and the effects that were unknowns of it.

        The recorded aortic waveform is part of the record, and no unknown.
        """
        effects = self.acting[hypothesis]
        if self.own is None or not effects or effects[-1].form != RECORDED:
            return self.record, effects
        return self.own, effects[:-1]

    @property
    def other_bed(self) -> float:
        """Probability that the bed is of another structure, with the most probable hypothesis."""
        return float(self.best.kinds[-1])
