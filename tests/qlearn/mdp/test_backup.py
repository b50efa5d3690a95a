"""Backed-up share vectors are those of eq. (3), compiled or not."""

import copy

import numpy as np
import pytest

from qlearn import OrdinalMDP, random_mdp
from qlearn.mdp.backup import back_up_together, model_of, q_of
from tests.mdp_cases import messy_mdp
from tests.scale_arithmetic import Floats


def backed_up(mdp: OrdinalMDP) -> tuple[Floats, Floats]:
    """Vectors (S, k), and Q after them."""
    v = np.random.default_rng(0).dirichlet(np.ones(mdp.k), size=mdp.n_states)
    return v, q_of(np.arange(mdp.n_states), v, model_of(mdp))


@pytest.mark.parametrize("discount", [0.0, 0.9])
@pytest.mark.parametrize("messy", [True, False])
def test_q_is_equation_3(messy: bool, discount: float) -> None:
    mdp, _ = (
        messy_mdp(0, n=30, m=4, discount=discount)
        if messy
        else random_mdp(40, 3, 5, discount, rng=0)
    )
    v, q = backed_up(mdp)
    ahead = (mdp.transitions @ v).reshape(q.shape)
    expected = (1 - mdp.discount) * mdp.vector_rewards() + mdp.discount * ahead
    expected[~mdp.admissible] = np.eye(mdp.k)[0]
    expected[mdp.terminal] = v[mdp.terminal, None]
    np.testing.assert_allclose(q, expected, rtol=0, atol=1e-15)
    some, together = np.array([mdp.n_states - 1, 3, 3]), np.empty((3, *q.shape[1:]))
    np.testing.assert_array_equal(q_of(some, v, model_of(mdp)), q[some])
    back_up_together(some, v, model_of(mdp), together)
    assert together.tobytes() == q[some].tobytes()


def test_a_copy_of_a_model_is_the_model_whose_arrays_only_are_read() -> None:
    """Copies could be written to, and machine code for such arrays is another one."""
    model = model_of(random_mdp(4, 2, 3, rng=0)[0])
    assert copy.deepcopy([model])[0] is model
    assert not any(part.flags.writeable for part in model if isinstance(part, np.ndarray))
