"""Each method does what its authors say of it, and none asks worse than at random by accident."""

import numpy as np
import pytest
from scipy.special import expit

import elicit
from benchmarks.contest import problems
from benchmarks.contest.harness import as_seed, play
from benchmarks.contest.methods import METHODS, START, WORST
from benchmarks.contest.methods import aprel as package
from benchmarks.contest.methods.expected_utility import ExpectedUtility
from benchmarks.contest.methods.gaussian_process import GaussianProcess
from benchmarks.contest.methods.information_directed import Laplace
from benchmarks.contest.methods.minimax_regret import MinimaxRegret
from benchmarks.contest.methods.policy_comparisons import PolicyComparisons
from benchmarks.contest.methods.polyhedral import Polyhedral
from benchmarks.contest.small_mdp import SmallMDP, drawn_gaps, tails_of
from tests.rival_cases import TRIED
from tests.thoroughness import scaled

TRUTHFUL = problems.TUTORS["truthful"]


def played(method, name, seed, questions, tutor="truthful"):
    mdp = problems.problem(name, seed)
    values = problems.scale(mdp.k, seed)
    made = problems.tutor(tutor, values, seed)
    told = problems.TUTORS[tutor]
    return play(method, mdp, values, made, told, questions, as_seed({"seed": seed}))


def after(method, name, seed, questions):
    """The method itself, after so many answers of a truthful tutor, and the hidden gaps."""
    played(method, name, seed, questions)
    return method, np.diff(problems.scale(problems.problem(name, seed).k, seed))


@pytest.mark.parametrize("name", TRIED)
def test_with_a_truthful_tutor_answers_lower_the_loss(name):
    runs = [
        played(METHODS[name].make(), problem, seed, 20)
        for problem in ("career", "fishery")
        for seed in (1, 2)
    ]
    before = np.mean([run["initial"][0] for run in runs])
    at_last = np.mean([run["initial"][-1] for run in runs])
    # who takes 20 answers to begin to know: see docs/contest.md
    slow = ("Gaussian", "policy comparisons", "disagreement", "max regret", "thompson")
    limit = 0.5 * before if any(part in name for part in slow) else 0.01
    assert at_last <= limit
    assert all(run["wrong"] == 0 for run in runs)


@pytest.mark.parametrize("name", [name for name in METHODS if METHODS[name].claims == WORST])
def test_claims_at_the_worst_state_are_true_of_a_truthful_tutor(name):
    run = played(METHODS[name].make(), "career", 1, 40)
    assert 0 < run["done"] <= 40
    assert run["worst"][-1] <= 0.01


@pytest.mark.parametrize("rule", ["current solution", "largest gap"])
def test_minimax_regret_bounds_the_loss_and_never_grows(rule):
    mdp = problems.problem("fishery", 2)
    values = problems.scale(mdp.k, 2)
    small, method = SmallMDP(mdp), MinimaxRegret(rule)
    optimum = small.shares(small.best(np.diff(values))[0]) @ values
    tutor = elicit.TruthfulTutor(values)
    method.start(mdp, TRUTHFUL, 0)
    regrets, n = [method.regret], 0
    while question := method.question():
        method.tell(int(tutor(elicit.Query.make("x", n, *question)).verdict))
        regrets.append(method.regret)
        loss = small.losses(method.policy(), values, optimum)[1]
        assert loss <= method.regret + 1e-6
        n += 1
    assert regrets[-1] <= 0.01
    assert (np.diff(regrets) <= 1e-6).all()


def test_no_lottery_has_less_regret_than_the_incumbent():
    """By brute force: the greatest regret over many scales, of lotteries over many policies."""
    mdp = problems.problem("career", 4)
    method, small = MinimaxRegret("largest gap"), SmallMDP(mdp)
    method.start(mdp, TRUTHFUL, 0)
    rng = np.random.default_rng(0)
    gaps = np.concatenate([np.eye(mdp.k - 1), drawn_gaps(mdp.k, 300, rng)])
    policies = small.best(gaps)
    tails = tails_of(np.array([small.from_start(policy) for policy in policies]))
    best = np.einsum("ij,ij->i", tails, gaps)

    def regret(found):
        return (best - gaps @ found).max()

    mine = tails_of(small.from_start(method.policy()))
    assert regret(mine) == pytest.approx(method.regret, abs=1e-6)
    lotteries = rng.dirichlet(np.full(len(tails), 0.01), size=3000) @ tails
    assert min(regret(found) for found in lotteries) >= method.regret - 1e-6


def test_aprel_has_the_figures_of_the_package():
    """The right sides were computed by the package's own functions on the same numbers."""
    w = np.array([[0.6, 0.8, 0.0], [0.48, 0.64, 0.6], [0.8, 0.0, 0.6], [0.28, 0.96, 0.0]])
    logs = np.array([-0.5, -1.0, -2.0, -0.25])
    f = np.array([[0.9, 0.5, 0.1], [0.7, 0.6, 0.3], [0.2, 0.9, 0.4], [0.5, 0.5, 0.5]])
    belief = package.Belief(f, 10.0, np.random.default_rng(0))
    belief.belief.weights, belief.belief.logs = w, logs
    information = package.mutual_information(expit(belief.rewards()))
    assert information == pytest.approx(
        [
            0.05090773727335994,  # trajectories 0 and 1
            0.39886825471136544,  # 0 and 2
            0.13026268208956854,  # 0 and 3
            0.2787084634302155,  # 1 and 2
            0.06165123926145652,  # 1 and 3
            0.41122525789320236,  # 2 and 3
        ],
        rel=1e-12,
    )
    assert package.by_information(belief) == (2, 3)
    assert package.disagreement(w[:2], logs[:2]) == pytest.approx(0.2294547154687666)
    assert set(package.by_disagreement(belief)) == {0, 2}
    assert set(package.by_thompson(belief)) == {0, 2}


def test_the_sampler_of_aprel_has_the_mean_of_the_package():
    """The package's sampler, with no weight below 0: three chains of 3,000 draws each.

    Their means were .580, .565, .559 for the first weight, .512, .535, .506 for the second and
    .634, .628, .657 for the third.
    """
    f = np.array([[0.9, 0.5, 0.1], [0.7, 0.6, 0.3], [0.2, 0.9, 0.4], [0.5, 0.5, 0.5]])
    belief = package.UnitWeights(3, 10.0, np.random.default_rng(0))
    for winner, loser in ((0, 1), (2, 1), (3, 2)):
        belief.tell(f[winner] - f[loser], 1)
    belief.SAMPLES = 9000
    belief.tell(np.zeros(3), 1)  # says nothing: a longer chain of the same posterior
    assert belief.mean == pytest.approx([0.568, 0.518, 0.640], abs=0.03)


@pytest.mark.parametrize(("rule", "one"), [("disagreement", False), ("max regret", True)])
def test_aprel_takes_the_best_of_all_pairs_of_samples(rule, one):
    rng = np.random.default_rng(2)
    belief = package.Belief(rng.random((12, 3)) + 0.1, 5.0, rng)
    best = belief.best_ones()
    scores = {}
    for i in range(40):
        for j in range(i + 1, 40):
            w, logs = belief.weights[[i, j]], belief.logs[[i, j]]
            scores[i, j] = (
                package.regret(w, logs, belief.features[[best[i], best[j]]])
                if one
                else package.disagreement(w, logs)
            )
    i, j = max(scores, key=lambda pair: scores[pair])
    belief.belief.weights, belief.belief.logs = belief.weights[:40], belief.logs[:40]
    assert package.RULES[rule](belief) == (best[i], best[j])


def test_max_regret_is_what_each_gives_up_by_the_choice_of_the_other():
    w, f = np.array([[0.6, 0.8], [1.0, 0.0]]), np.array([[0.2, 0.9], [0.7, 0.3]])
    found = package.regret(w, np.zeros(2), f)
    assert found == pytest.approx(1 - 0.66 / 0.84 + 1 - 0.2 / 0.7)
    assert package.regret(w, np.zeros(2), f[[0, 0]]) == 0.0


def test_volume_removal_is_nothing_for_equal_trajectories():
    rewards = np.array([[0.0, 0.0], [3.0, -3.0], [3.0, 3.0]])
    assert package.volume_removal(rewards) == pytest.approx([0.0, 0.5 * (1 - np.exp(-3)), 0.0])


@pytest.mark.parametrize(
    ("linear", "means", "variances"),
    [
        (
            True,
            [0.44746131, 0.81775507, 0.52825339, 0.24489403, 0.57904036],
            [0.38736875, 0.26162283, 0.26195632, 0.31707251, 0.60519225],
        ),
        (
            False,
            [-0.08362439, 0.23158745, 0.01059908, -0.20186278, 0.06175792],
            [0.22814346, 0.16031878, 0.16547734, 0.17767326, 0.58688981],
        ),
    ],
)
def test_the_gaussian_process_has_the_figures_of_the_authors(linear, means, variances):
    """The figures are by the authors' own code, which has a jitter of .01 in the curvature.

    With the prior mean of zero, four points beat the worst vector and lose to the best one.
    """
    points = np.array([[0.1, 0.9], [0.5, 0.6], [0.8, 0.3], [0.9, 0.05], [0.3, 0.7], [0, 0], [1, 1]])
    process = GaussianProcess(points, 0.1, linear)
    process.tell((1, 0), (1, 2), (2, 3))
    if not linear:
        process.tell(*((i, 5) for i in range(4)), *((6, i) for i in range(4)))
    assert process.mean[:5] == pytest.approx(means, abs=1e-7)
    assert process.variance[:5] == pytest.approx(variances, abs=2e-3)


def test_query_iteration_finds_about_the_best_pair_of_policies():
    method, _ = after(ExpectedUtility(), "reservoir", 1, 1)
    gaps, small = method._posterior.gaps, method._small
    shares = np.array([small.from_start(policy) for policy in small.best(gaps[:60])])
    worth = tails_of(shares) @ gaps.T
    best = max(np.maximum(a, b).mean() for a in worth for b in worth)
    left, right = method.question()
    found = np.maximum(tails_of(left) @ gaps.T, tails_of(right) @ gaps.T).mean()
    single = worth.mean(axis=1).max()
    assert found - single >= 0.9 * (best - single)


def test_idrl_foretells_the_variance_that_an_answer_leaves():
    belief = Laplace(3, 20.0)
    belief.tell(np.array([0.2, -0.1, 0.05]))
    d, about = np.array([[0.1, -0.2, 0.1]]), np.array([0.3, -0.3, 0.2])
    chance = expit(20.0 * d[0] @ belief.mean)
    more = 20.0**2 * chance * (1 - chance) * np.outer(d[0], d[0])
    after = np.linalg.inv(np.linalg.inv(belief.covariance) + more)
    assert belief.left_after(d, about) == pytest.approx([about @ after @ about])
    assert np.ones(3) @ belief.mean == pytest.approx(1.0, abs=0.02)


def test_idrl_has_the_figure_of_the_authors():
    """The right side was computed by the authors' ``get_conditional_cov`` on the same numbers."""
    belief = Laplace(3, 20.0)
    rows = np.array([[0.2, -0.1, 0.05], [-0.3, 0.4, 0.1], [0.1, 0.1, -0.2]])
    belief.mean, belief._rows = np.array([0.5, 0.2, 0.3]), rows
    belief.covariance = np.linalg.inv(belief._curvature(expit(20.0 * rows @ belief.mean)))
    found = belief.left_after(np.array([[0.1, -0.2, 0.1]]), np.array([0.3, -0.3, 0.2]))
    assert found == pytest.approx([0.005927750034107226], rel=1e-12)


def test_the_mode_of_idrl_is_where_the_slope_is_nothing():
    belief = Laplace(3, 30.0)
    rows = np.random.default_rng(3).normal(size=(8, 3))
    for row in rows:
        belief.tell(row)

    def height(g):
        off = g - 1 / 3
        return np.log(expit(30.0 * rows @ g)).sum() - 0.5 * off @ belief._inverse @ off

    for i in range(3):
        step = 1e-5 * np.eye(3)[i]
        assert height(belief.mean) >= height(belief.mean + step)
        assert height(belief.mean) >= height(belief.mean - step)


def test_policy_comparisons_find_every_ratio():
    method, gaps = after(PolicyComparisons(), "fishery", 1, 60)
    worth = tails_of(np.array(method._basis)) @ gaps
    assert len(worth) >= 2
    for ratio, (low, high) in zip(worth / worth[0], method._ranges, strict=True):
        assert ratio == pytest.approx(1.0) or low - 1e-9 <= ratio <= high + 1e-9
        assert high - low <= 0.0201 or ratio == pytest.approx(1.0)


def test_policy_comparisons_take_as_many_questions_as_binary_search():
    """The authors promise so many: a logarithm for each basis policy, one for each objective."""
    mdp = problems.problem("fishery", 1)
    method = PolicyComparisons()
    run = played(method, "fishery", 1, 60)
    p, ratios = mdp.k - 1, len(method._basis) - 1
    halvings = int(np.ceil(np.log2(2.0 / 0.02)))  # from 0..2 to 0.01 either way
    assert 0 < run["done"] <= p - 1 + ratios * (1 + halvings)


def test_both_sides_of_a_polyhedral_question_are_equally_good_for_the_centre():
    mdp, values = (
        problems.problem("fishery", 1),
        problems.scale(problems.problem("fishery", 1).k, 1),
    )
    method, tutor = Polyhedral(), elicit.TruthfulTutor(values)
    method.start(mdp, TRUTHFUL, 0)
    apart = []
    for n in range(8):
        left, right = method.question()
        apart.append(abs(tails_of(left - right) @ method._centre))
        method.tell(int(tutor(elicit.Query.make("x", n, left, right)).verdict))
    assert np.median(apart) < 1e-9


def test_the_centre_of_the_polyhedral_method_is_that_of_the_polytope():
    method, gaps = after(Polyhedral(), "fishery", 1, 4)
    d = np.column_stack([method._rows, np.zeros(len(method._rows))])
    d = np.column_stack([-method._rows[:, :1], method._rows[:, :-1] - method._rows[:, 1:],
                         method._rows[:, -1:]])  # fmt: skip
    answers = elicit.Answers(d / 2, np.ones(len(d), dtype=int))
    known = elicit.PolytopeComparator(len(gaps) + 1, margin=1e-12).update(answers)
    assert np.diff(known.values) == pytest.approx(method._centre, abs=1e-5)


def test_contradictions_do_not_stop_the_polyhedral_method():
    run = played(Polyhedral(), "fishery", 1, 30, "flips")
    assert run["wrong"] > 0
    assert np.isfinite(run["initial"]).all()


def test_nobody_is_below_random_pairs_but_those_that_the_page_explains():
    """Over some runs with a truthful tutor: the mean loss from the start over 12 answers."""
    explained = ("Gaussian", "policy comparisons", "APReL", "IDRL", "qEUBO")
    names = [name for name in METHODS if not any(part in name for part in explained)]
    area = {}
    for name in names:
        curves = [
            played(METHODS[name].make(), problem, seed, 12)["initial"][3:]
            for problem in scaled(("career",), ("career", "reservoir"))
            for seed in range(scaled(2, 6))
        ]
        area[name] = np.mean(curves)
    assert max(area.values()) <= area["random pairs"] + 0.01


def test_every_method_says_what_it_claims():
    assert {entry.claims for entry in METHODS.values()} == {"", WORST, START}
