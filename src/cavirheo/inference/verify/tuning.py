"""Every number that decides how a posterior is sampled and judged, by its physical or statistical meaning."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """Chosen on simulated shots (validation/claims/calibration.py); lengths are in u, where each prior is the standard
    normal, heights are differences of log posterior."""

    # draws that are simulated and weighed
    draws: int = 1800  # at most
    draws_per_round: int = 200
    weighed_rounds: int = 4  # surrogates, at most, that these are of
    effective_enough: float = 400.0  # effective draws at which level "full" ends
    effective_fewest: float = 100.0  # below which no interval is given

    # the network's draws
    own_draws: int = 48  # of a network's draws that are simulated: the way to the maximum, and an evidence
    own_draws_each: int = 24  # the same of each of several laws
    own_unexpected: float = 6.0  # height of one over the Gaussian about the maximum, from which it is on another hill
    own_worth: float = 5.0  # effective size of them, from which their evidence says something,
    own_error: float = 0.6  # whose log has this standard error at least
    auto_enough: float = 300.0  # effective draws of the whole answer of level "auto"
    corrected: int = 6  # likely places where default simulations tell what rough ones miss
    corrected_spread: float = 12.0  # effective size of the network's draws that they are chosen among
    corrected_scatter: float = 0.15  # standard deviation of what they find wrong in log weights: else no rough ones
    agree: float = 3.0  # standard errors, by which the network's evidence may be the larger one

    # draws of a surrogate
    emulated_rounds: int = 20  # of simulations that check it, at most,
    emulated_turns: int = 4  # so many before the shares of all models are compared anew
    emulated_checked: int = 20  # of its draws in each, by default simulations,
    emulated_flatter: int = 4  # and rough ones of flatter ones, for what it misses
    pool: float = 40.0  # effective draws of one while it is taught,
    emulated_worth: float = 2.5  # effective draws over those that are asked for,
    emulated_draws: float = 2.0  # and draws over these
    emulated_unsure: float = 0.1  # standard error of its log evidence, at least
    emulated_enough: float = 0.3  # standard deviation of what they find wrong in log weights: then it is trusted,
    emulated_worst: float = 1.0  # or, of a model with a small share, this over its share, at most this; that much where
    # all rounds have not made it better, and weights of simulated draws are worth too little,
    emulated_patience: float = 8.0  # or after so many more rounds twice as much
    emulated_moved: float = 0.6  # change of its log evidence by the last check, over the share: then one more round
    emulated_wrong: float = 1.2  # standard deviation of what is found wrong, from which
    emulated_more: int = 3  # times as many draws check the next one

    # Markov chains of a surrogate
    walkers: tuple[int, int] = (200, 400)  # how many, by the draws that are needed
    begun: int = 4  # places from which each begins,
    begun_camera: float = 0.3  # standard deviation of their cameras, beyond what a line misses,
    walked_on: float = 0.7  # of them that begin where the last ones ended
    walked: float = 3.4  # largest step along a difference, times the root of the number of coordinates,
    walked_whole: float = 0.1  # of the steps that go the whole difference,
    walked_straight: float = 0.8  # and that are taken in coordinates in which ridges are straighter
    walked_between: int = 8  # steps and jumps between two fits of the mixture
    settling_teaching: int = 2  # fits, at most, of walkers whose draws only teach the next surrogate,
    settling_most: int = 12  # and of others, until the mean height of the walkers
    settled: float = 0.3  # changes by less in three of them
    lowest_walker: float = 15.0  # height below the best, from which it does not matter how low one is
    walked_most: int = 12  # states of each walker that are kept, at most
    lifted: float = 0.65  # of the draws lie below the value of a parameter from which on there are more of them
    bridged: int = 30  # iterations of the integral

    # draws of a density that is quick to know
    adapted_most: int = 24  # rounds of them, at most
    adapted_good: float = 0.05  # effective draws over draws, below which a proposal is adapted,
    adapted_eased: float = 0.8  # times as many after each,
    adapted_last: int = 3  # to the last rounds

    # the camera of a simulation that counts, integrated by points
    integrated_points: tuple[int, ...] = (32, 32, 48)  # in stages,
    integrated_scale: float = 0.4  # standard deviation of the first, in that of the prior,
    integrated_kept: float = 6.0  # effective points that the next stage goes through,
    integrated_wider: float = 1.4  # so much wider
    integrated_height: float = 12.0  # below the best, from which it is not worth it

    # models of one curve, each with its part in the answer
    part_unlike: float = 6.0  # log of how much likelier the best law is than its limit, from which other laws have none
    part_small: float = 0.05  # of the answer, below which few simulations tell a part well enough,
    part_seen: float = 0.01  # below which it changes the answer too little to be told better,
    part_unsure: float = 2.0  # standard deviation of what a preview finds wrong in a log evidence that is not relied on
    part_known: float = 1.0  # standard error of a log evidence, above which a part is sampled, however small it seems
    other_law: float = 3.0  # height of another model above this one, from which it is looked at where that is best
    part_thorough: float = 0.2  # of the answer, above which other modes are looked for

    # where searches start
    scanned: int = 96  # coarse simulations all over the ranges
    scanned_climbed: float = 1.0 / 32.0  # how many of them are climbed from
    search_unlike: float = 4.0  # squared difference of frames over noise, below which a search has come to a minimum
    fit_wide: float = 0.3  # of the draws about the modes of a fit that are twice as wide
    rival_scanned: int = 32  # where the other of the real and the field's bubble is looked at beside a fit
    same_start: float = 0.005  # starts nearer to each other are one

    searched_above: float = 0.015  # of R_max: misfit beyond noise, from which windows that grow are searched, too, and
    # damage is tried

    # climbing to a mode, damped Gauss-Newton
    climb_steps: int = 12  # at most
    climb_gain: float = 0.03  # expected gain of height at which it ends
    climb_hopeless: float = 3.0  # times the depth of the lowest mode: expected height below the best at which it ends
    climb_surrogates: int = 4  # that show the way, at most, until one finds its end
    climb_expected: float = 0.5  # as high as the simulation there, within this
    near_mode: float = 2.0  # Mahalanobis distance over the root of the number of coordinates, within which one is known
    same_mode: float = 1.0  # Mahalanobis distance below which modes are one
    lowest_mode: float = 10.0  # height below the best at which one is dropped

    # mixtures of Student's t
    freedom: float = 8.0  # degrees
    wide_share: float = 0.2  # of the draws, for what the fitted shape misses
    wide_factor: float = 2.0  # how much wider these are
    smallest_share: float = 0.005  # of a component, below which it is dropped

    # how far weights are trusted
    tail_share: float = 0.2  # of the draws, that the tail index looks at
    tail_reliable: float = 0.7  # tail index above which the mean weight is not to be trusted,
    tail_unseen: float = 0.02  # unless at most this share is expected beyond the largest

    # mixtures that are drawn from
    flat_share: float = 0.5  # of a mixture through its draws that is
    flat_factor: float = 4.0  # so much wider, where the next ones begin
    joint_wide: float = 0.2  # of the mixture of u and camera to which walkers jump that is
    joint_factor: float = 1.5  # so much wider
    joint_each: float = 5.0  # walkers for each coordinate of a component,
    joint_components: int = 8  # at most so many
    shelf_share: float = 0.2  # of it where one coordinate is as wide as its prior,
    shelf_end: float = 2.0  # at such an end of the prior
    shelf_reach: float = 4.0  # standard deviations at most from where the frames are,
    flatter: float = 0.5  # power of the surrogate that teaches, for what it misses
    adapted: float = 6.0  # effective draws for each coordinate that a mixture is then fitted to,
    adapted_components: int = 10  # with so many components at most,
    adapted_each: float = 2.0  # for each of its coordinates,
    adapted_fits: int = 4  # in so many calls of the fit,
    adapted_modes: float = 0.1  # and so much of it stays with the modes
    modes_share: float = 0.3  # of the mixture's draws that stay with the modes
    other_mode: float = 0.5  # height above the best mode of a draw in another mode
    modes_climbed: int = 3  # climbed into at most

    # the surrogate, a Gaussian process of the bubble
    flat_height: float = 10.0  # below the best, at which a simulation counts 1/e in them
    whitened: float = 4.0  # effective simulations for each coordinate, at least, that give its units
    nugget_height: float = 3.0  # below the best, in which the nugget of a simulation grows,
    nugget_most: float = 300.0  # up to this factor
    direction_share: float = 0.05  # of the noise, below which a direction is left out
    grid_share: float = 1e-2  # of a grid point of the noise in a likely simulation, below which it is left out
    left_out: int = 40  # likely simulations, told by the others, that choose the kernel
    surrogate_latest: int = 160  # simulations that it knows, those that checked the last ones among them,
    surrogate_likely: int = 340  # and the most likely others: time grows with their square
    surrogate_reach: float = 1.5  # distance over the farthest simulation's, to which it claims

    # what is said of an answer
    systematic: float = 0.03  # of R_max: misfit beyond noise that rejects a law
    systematic_seen: float = 5e-4  # of R_max: misfit below which none is stated
    pulled: float = 2.3  # a nuisance that far from its middle has 1 % of its prior beyond it
    nearest_steps: int = 12  # of least squares from the maximum, where a misfit is no noise
    replicates: int = 2000  # of the predictive check
    rejected: float = 0.01  # probability of its rejection where the law is right

    # evidence of laws
    hopeless: float = 25.0  # Laplace's log evidence below the best of the curve, from which no draws are spent on it
    unsure: float = 1.0  # standard error where weights are not to be trusted


TUNING = Tuning()
