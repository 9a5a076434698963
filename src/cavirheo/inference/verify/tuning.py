"""Every number that decides how a posterior is sampled and judged, by its physical or statistical meaning."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """Chosen on simulated shots (validation/claims/calibration.py).

    Lengths are in u, where each prior is the standard normal distribution. Heights and depths are differences of log
    posterior. An effective number of draws is that of independent draws that tell as much. The share of a model is its
    probability in the answer.
    """

    # What an answer needs.
    effective_fewest: float = 100.0  # With fewer effective draws no interval is given.
    effective_auto: float = 300.0  # Level "auto" takes so many effective draws in the whole answer.
    effective_full: float = 400.0  # Level "full" ends at so many effective draws.
    draws: int = 1800  # At most so many draws are simulated and weighed; a Gaussian about a maximum gives as many.
    draws_per_round: int = 200  # So many draws are simulated before their weights are looked at.
    weighted_rounds: int = 4  # Draws that are weighed come from at most so many surrogates, one after the other.

    # Draws of a network.
    network_draws: int = 48  # So many draws of a network are simulated first when one law is asked for.
    network_draws_each: int = 24  # So many are simulated for each of several laws.
    network_unexpected: float = 6.0  # A draw so far above the Gaussian about the maximum is climbed from.
    network_effective: float = 5.0  # With fewer effective draws the network's evidence is not compared.
    network_error: float = 0.6  # The log of the network's evidence has at least this standard error.
    network_agreement: float = 3.0  # It may lie so many standard errors above the evidence of the answer's draws.

    # What rough simulations miss.
    correction_places: int = 6  # Default simulations at so many likely places tell it.
    correction_effective: float = 12.0  # These places are chosen among so many effective draws.
    correction_scatter: float = 0.15  # Rough simulations are given up if the log weights scatter by more about it.

    # A surrogate, and the simulations that check it.
    surrogate_rounds: int = 20  # A model has at most so many rounds of checks.
    surrogate_turn: int = 4  # After so many rounds the shares of all models are compared again.
    checked_draws: int = 20  # So many draws of the surrogate are simulated in a round to check it.
    flat_draws: int = 4  # So many draws of a flattened surrogate are simulated beside them, for what it misses.
    flat_power: float = 0.5  # The flattened surrogate is this power of the surrogate.
    teaching_effective: float = 40.0  # While a surrogate is taught, so many effective draws of it are taken.
    effective_margin: float = 2.5  # For an answer so many times the effective draws are taken that it needs.
    draws_per_effective: float = 2.0  # So many draws are taken for an effective one.
    surrogate_evidence_error: float = 0.1  # The log evidence of a surrogate has at least this standard error.
    surrogate_error: float = 0.3  # Log weights may be wrong by this standard deviation, over the share,
    surrogate_error_most: float = 1.0  # and at most by this, however small the share is.
    surrogate_patience: float = 8.0  # After so many further rounds they may be wrong by twice as much.
    evidence_change: float = 0.6  # If the last check changes the log evidence by more, over the share, a round follows.
    wrong_surrogate: float = 1.2  # If log weights are wrong by more than this standard deviation, the next round has
    wrong_factor: int = 3  # so many times the checks.

    # Markov chains on a surrogate.
    walkers: tuple[int, int] = (200, 400)  # The fewest and the most walkers; the draws that are needed decide.
    starts_per_walker: int = 4  # A walker begins at one of so many draws, by their weights.
    start_camera_spread: float = 0.3  # The camera of a start scatters by this more than a regression leaves.
    continued_share: float = 0.7  # So large a part of the walkers begins where those of the last surrogate ended.
    step_factor: float = 3.4  # The largest step is this over the root of the number of coordinates, in differences.
    whole_steps: float = 0.1  # So large a part of the steps takes a whole difference of two walkers.
    straight_steps: float = 0.8  # So large a part of the steps is taken in coordinates in which ridges are straight.
    steps_per_fit: int = 8  # The mixture to which walkers jump is fitted again after so many steps and jumps.
    fits_teaching: int = 2  # Walkers that only teach the next surrogate settle in at most so many fits.
    fits_most: int = 12  # Other walkers settle in at most so many fits.
    settled_change: float = 0.3  # Walkers have settled if their mean height changes by less in three fits.
    walker_depth: float = 15.0  # In this mean no walker counts as lower than so far below the best.
    states_per_walker: int = 12  # At most so many states of each walker are kept.
    raised_above: float = 0.65  # Above this quantile of a parameter of the law more draws are taken, for a bound.
    bridge_iterations: int = 30  # The integral is found in so many iterations.

    # Importance sampling by an adaptive proposal.
    proposal_rounds: int = 24  # At most so many rounds of draws are taken.
    proposal_efficiency: float = 0.05  # A proposal with a smaller part of effective draws is adapted.
    proposal_easing: float = 0.8  # This limit is multiplied by so much after each adaptation.
    proposal_memory: int = 3  # A proposal is adapted to so many of the last rounds.

    # The integral over the camera of a simulation.
    camera_points: tuple[int, ...] = (32, 32, 48)  # So many points are taken in each stage.
    camera_scale: float = 0.4  # Points of the first stage scatter by this part of the prior's standard deviation.
    camera_effective: float = 6.0  # The next stage is fitted to so many effective points,
    camera_widening: float = 1.4  # and is so many times wider.
    camera_depth: float = 12.0  # Simulations farther below the best are not integrated.

    # Several models of one curve.
    share_least: float = 0.01  # A model with a smaller share changes the answer too little to be sampled.
    share_small: float = 0.05  # Few simulations tell a smaller share well enough.
    share_large: float = 0.2  # Of a model with a larger share further modes are looked for.
    evidence_known: float = 1.0  # A model with a larger standard error of the log evidence is sampled, if in reach.
    evidence_reach: float = 2.0  # For this a log evidence may be too low by its error, but by no more than this.
    limit_unlike: float = 6.0  # If the best law is so far above its limit, other laws are taken without a limit.
    other_model_height: float = 3.0  # Where another model is so much higher, this one is simulated, too.
    evidence_hopeless: float = 25.0  # A model whose Laplace evidence is so far below the best gets no draws.
    evidence_distrusted: float = 1.0  # A log evidence has this standard error if its weights are not to be trusted.

    # Where searches start.
    scan_points: int = 96  # So many coarse simulations are spread over the ranges.
    scan_climbed: float = 1.0 / 32.0  # So large a part of them is climbed from.
    rival_scan_points: int = 32  # So many look for the other of the real and the field's bubble beside a fit.
    search_distance: float = 4.0  # A search ends where the squared difference of frames over noise is smaller.
    fit_wide_share: float = 0.3  # So large a part of the draws about the modes of a fit is twice as wide.
    start_distance: float = 0.005  # Starts nearer to each other are one.
    large_misfit: float = 0.015  # A misfit over R_max beyond noise from which longer windows and damage are tried.

    # Climbing to a mode by damped Gauss-Newton steps.
    climb_steps: int = 12  # At most so many steps are taken.
    climb_gain: float = 0.03  # It ends when a step promises less height.
    climb_depth: float = 30.0  # It is given up when it promises to end so far below the best mode.
    climb_surrogates: int = 4  # At most so many surrogates show the way.
    climb_tolerance: float = 0.5  # They end where a simulation is as high as they say, within this.
    mode_reach: float = 2.0  # Simulations within this Mahalanobis distance, over the root of the dimension, are near.
    mode_distance: float = 1.0  # Modes within this Mahalanobis distance are one.
    mode_depth: float = 10.0  # A mode so far below the best is dropped.

    # Mixtures of Student's t distributions.
    degrees_of_freedom: float = 8.0  # Each component has so many.
    wide_share: float = 0.2  # So large a part of a mixture is wider, for what the fitted shape misses.
    wide_factor: float = 2.0  # It is so many times wider.
    component_least: float = 0.005  # A component with a smaller part of the mixture is dropped.
    mixture_effective: float = 6.0  # A mixture is fitted to so many effective draws for each coordinate.
    mixture_components: int = 10  # It has at most so many components.
    component_effective: float = 2.0  # Each component has so many effective draws for each coordinate.
    mixture_fits: int = 4  # A fit takes so many iterations.
    mixture_modes: float = 0.1  # So large a part of a mixture through draws stays with the modes.
    start_modes: float = 0.3  # So large a part of the first draws stays with the modes.
    start_wide_share: float = 0.5  # So large a part of the mixture in which walkers begin is wider.
    start_wide_factor: float = 4.0  # It is so many times wider.

    # Mixtures to which walkers jump.
    jump_wide_share: float = 0.2  # So large a part is wider.
    jump_wide_factor: float = 1.5  # It is so many times wider.
    jump_walkers: float = 5.0  # Each component has so many walkers for each coordinate.
    jump_components: int = 8  # It has at most so many components.
    flat_tail_share: float = 0.2  # So large a part lies in flat tails, where one coordinate is as wide as its prior.
    flat_tail_end: float = 2.0  # A tail is looked for at this distance from the middle of the prior.
    flat_tail_reach: float = 4.0  # The frames may exclude it by at most so many standard deviations.

    # Simulations that lead to further modes.
    other_mode_height: float = 0.5  # A simulation so far above the best mode lies in another one.
    other_modes: int = 3  # At most so many are climbed to.

    # The surrogate, a Gaussian process of the bubble.
    flattened_depth: float = 10.0  # A simulation so far below the best counts 1/e in the units of the coordinates.
    whitened_effective: float = 4.0  # So many effective simulations for each coordinate give these units, at least.
    nugget_depth: float = 3.0  # The nugget of a simulation grows with its depth over this,
    nugget_most: float = 300.0  # at most to so many times its value.
    direction_least: float = 0.05  # Directions in which frames change by a smaller part of the noise are left out.
    noise_point_least: float = 1e-2  # Points of the noise's grid with less weight in likely simulations are left out.
    likely_left_out: int = 40  # So many likely simulations, each left out in its turn, choose the kernel.
    surrogate_latest: int = 160  # It knows so many of the latest simulations, which checked the last surrogates,
    surrogate_likely: int = 340  # and so many of the likeliest others: its time grows with the square of the number.
    surrogate_reach: float = 1.5  # It is zero beyond so many times the distance of the farthest simulation.

    # What is said of an answer.
    misfit_rejected: float = 0.03  # A misfit over R_max beyond noise that is larger rejects the law.
    misfit_seen: float = 5e-4  # A misfit over R_max that is smaller is not stated.
    prior_end: float = 2.3  # A nuisance so far from the middle of its prior has 1 % of it beyond.
    nearest_steps: int = 12  # So many steps of least squares from the maximum tell how small the misfit can be.
    replicates: int = 2000  # The predictive check takes so many.
    p_rejected: float = 0.01  # It rejects a law with this probability if the law is right.

    # How far weights are trusted.
    tail_share: float = 0.2  # The tail index is that of so large a part of the draws.
    tail_index_most: float = 0.7  # With a larger tail index the mean of the weights is not trusted,
    tail_unseen: float = 0.02  # unless a smaller part of it is expected beyond the largest weight.


TUNING = Tuning()
