import numpy as np

from truepose.compensation import solve

SLOPE = np.array([[0.02, -0.01, 0.0], [0.005, 0.03, 0.01], [0.0, 0.01, -0.02]])
OFFSET = np.array([0.5, -1.0, 0.25])


def linear(p, _rows=None):
    return p @ SLOPE.T + OFFSET


def test_closed_form_of_a_linear_error(rng):
    """P_c + S P_c + o = P_t has the solution (I + S)⁻¹ (P_t − o)."""
    p_target = rng.uniform(-1000, 1000, size=(50, 3))
    expected = np.linalg.solve(np.eye(3) + SLOPE, (p_target - OFFSET).T).T
    for gradient in (None, lambda p, _rows: np.broadcast_to(SLOPE, (len(p), 3, 3))):
        solution = solve(p_target, linear, gradient)
        assert solution.converged.all()
        np.testing.assert_allclose(solution.command, expected, atol=1.1e-4)
        np.testing.assert_allclose(solution.command + solution.error, p_target, atol=1e-4)


def test_newton_takes_one_step_for_a_linear_error(rng):
    p_target = rng.uniform(-1000, 1000, size=(50, 3))
    assert solve(p_target, linear, lambda p, _rows: np.broadcast_to(SLOPE, (len(p), 3, 3))).iterations == 1
    assert solve(p_target, linear).iterations > 3


def test_mirror_differs_in_second_order():
    p_target = np.array([[1000.0, 0.0, 0.0]])
    found = solve(p_target, linear)
    difference = found.mirror - found.command
    np.testing.assert_allclose(difference, -linear(p_target) @ SLOPE.T, rtol=0.1, atol=0.05)


def test_no_error_no_step():
    p_target = np.ones((4, 3))
    solution = solve(p_target, lambda p, _rows: np.zeros_like(p))
    np.testing.assert_array_equal(solution.command, p_target)
    assert solution.iterations == 0


def test_a_target_that_does_not_settle_is_told():
    def wild(p, _rows):
        return np.where(p[:, :1] > 0, -3.0 * p, 0.1)  # no contraction where x > 0

    solution = solve(np.array([[1.0, 1.0, 1.0], [-5.0, 0.0, 0.0]]), wild)
    assert solution.converged.tolist() == [False, True]


def test_no_targets():
    assert solve(np.empty((0, 3)), linear).command.shape == (0, 3)


def test_poses_in_one_equation(rng):
    """Errors of position and orientation that depend on both: R_c = exp(−w) R_t is ω + w = 0."""
    slope = np.diag([0.02, 0.03, -0.01, 0.02, 0.01, 0.03])
    slope[0, 4], slope[3, 1] = 200.0, 1e-5  # mm per rad, rad per mm
    offset = np.array([0.5, -1.0, 0.25, 1e-3, -5e-4, 2e-3])
    target = np.c_[rng.uniform(-1000, 1000, size=(20, 3)), np.zeros((20, 3))]
    found = solve(target, lambda command, _rows: command @ slope.T + offset)
    expected = np.linalg.solve(np.eye(6) + slope, (target - offset).T).T
    assert found.converged.all()
    np.testing.assert_allclose(found.command[:, :3], expected[:, :3], atol=1.1e-3)
    np.testing.assert_allclose(found.command[:, 3:], expected[:, 3:], atol=1.1e-6)
