"""Paper 1 on a four-link arm, in pictures: inertia is covariance, the filter whitens, the smoother estimates.

    pip install matplotlib ./crates/python
    python examples/random_field.py pictures            # writes four SVG files there

Rodriguez, "Random field estimation approach to robot dynamics", IEEE Transactions on Systems, Man, and Cybernetics 20 (1990). Cells
are marked `# %%`: editors show this file as a notebook. Numbers in brackets are the paper's equations, as corrected in
docs/src/papers.md.
"""

# %% A planar arm, and the operators of one configuration
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import argparse

import matplotlib.pyplot as plt
import numpy as np

import phipsi

HERE = Path(__file__).resolve().parent
parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("folder", nargs="?", default="pictures", help="where the pictures go")
OUT = Path(parser.parse_args().folder)
OUT.mkdir(parents=True, exist_ok=True)
plt.rcParams.update({"svg.hashsalt": "phipsi", "svg.fonttype": "none", "font.size": 9, "figure.constrained_layout.use": True})


def save(figure, name):
    """The same bytes each time."""
    figure.savefig(OUT / f"{name}.svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)


arm = phipsi.Model.from_urdf(str(HERE / "four_link_arm.urdf"))
q = np.array([0.4, 0.7, -0.5, 0.9])
ops = phipsi.operators(arm, q)
phi, psi, H, M, P, D, G, K = ops.phi, ops.psi, ops.H, ops.M, ops.P, ops.D, ops.G, ops.K
names = arm.joint_names

# %% The mass matrix is an expression; its inverse comes as filter and smoother
mass = H @ phi @ M @ phi.T @ H.T
print("𝓜    =", mass, " cost", mass.cost)
print("𝓜⁻¹  =", mass.inv(), " cost", mass.inv().cost)
assert np.allclose(mass.dense(), arm.mass_matrix(q), rtol=1e-13)

# %% The random field (5.1)–(5.4): W ~ N(0, M(k)) body by body, X = φ W, T = H X
random = np.random.default_rng(1)
inertias = M.dense()
root = np.linalg.cholesky(inertias)
W = random.normal(size=(100_000, 6 * len(ops.bodies))) @ root.T
X = phi @ W
T = H @ X

# %% Inertia is covariance (6.3): clouds of joint moments, and the ellipses of the mass matrix
want = mass.dense()
figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.2))
circle = np.linspace(0, 2 * np.pi, 200)
for ax, (i, j) in zip(axes, [(0, 1), (0, 3), (2, 3)]):
    ax.plot(T[:200, i], T[:200, j], ".", ms=3, alpha=0.5)
    block = want[np.ix_([i, j], [i, j])]
    for sigma in (1, 2):
        ellipse = sigma * np.linalg.cholesky(block) @ [np.cos(circle), np.sin(circle)]
        ax.plot(*ellipse, color="C1", lw=1.2)
    ax.set(xlabel=f"T at {names[i]}, N·m", ylabel=f"T at {names[j]}, N·m")
axes[1].set_title("200 draws of T, and 1σ and 2σ of the mass matrix")
save(figure, "random_field_covariance")

# %% The estimate of 𝓜 from N draws is wrong by √((‖𝓜‖² + tr²𝓜)/N), on average
counts = np.array([10, 30, 100, 300, 1000, 3000, 10_000])
expected = np.sqrt((np.linalg.norm(want) ** 2 + np.trace(want) ** 2) / counts)
figure, ax = plt.subplots(figsize=(6, 3.4))
all_errors = []
for n in counts:
    groups = T[: 100_000 // n * n].reshape(-1, n, arm.nv)[:200]
    estimates = np.einsum("gni,gnj->gij", groups, groups) / n
    errors = np.linalg.norm(estimates - want, axis=(1, 2))
    all_errors.append(np.sqrt(np.mean(errors**2)))
    ax.loglog(np.full(min(len(errors), 30), n), errors[:30], ".", color="C0", ms=3, alpha=0.5)
ax.loglog(counts, expected, color="C1", label=r"$\sqrt{(\|\mathcal{M}\|^2 + \mathrm{tr}^2\mathcal{M})/N}$")
ax.set(xlabel="draws N", ylabel="error of the estimate, kg·m²", title="The mass matrix, measured: error falls like 1/√N")
ax.legend()
save(figure, "random_field_rate")
assert np.all(np.abs(np.array(all_errors) / expected - 1) < 0.35), all_errors / expected

# %% The filter (9.3)–(9.10): z = ψ K T, innovations ε = T − H z are white with covariance D (Lemma 7)
z = (psi @ K) @ T
epsilon = T - H @ z
L = ops.I_joint - H @ psi @ K
assert np.allclose(epsilon, L @ T)
figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.4))
for ax, data, title in [(axes[0], T, r"moments T: covariance $\mathcal{M}$"), (axes[1], epsilon, "innovations ε: covariance D")]:
    correlation = np.corrcoef(data, rowvar=False)
    ax.imshow(correlation, vmin=-1, vmax=1, cmap="RdBu")
    for i in range(arm.nv):
        for j in range(arm.nv):
            ax.text(j, i, f"{correlation[i, j]:.2f}", ha="center", va="center", color="w" if abs(correlation[i, j]) > 0.6 else "k")
    ax.set(xticks=range(arm.nv), yticks=range(arm.nv), xticklabels=names, yticklabels=names, title=title)
figure.suptitle("Correlations of 100 000 draws, before and after the filter")
save(figure, "random_field_filter")
assert np.allclose(np.cov(epsilon, rowvar=False), D.dense(), atol=5 * D.dense().max() / np.sqrt(len(T)))

# %% The smoother (9.11)–(9.14): ν = D⁻¹ ε, α = ψ* H* ν, f = z + P α, θ̈ = ν − K* α
nu = ops.D_inverse @ epsilon
alpha = (psi.T @ H.T) @ nu
f = z + P @ alpha
acceleration = nu - K.T @ alpha
assert np.allclose(acceleration[0], arm.solve_mass_matrix(q, T[0]), rtol=1e-10)

# %% Errors: X − z has the covariance ψ M ψ* (Lemma 8), X − f has 𝒫 = ψ M ψ* − P Ω P (Lemma 11)
filtered_error = psi @ M @ psi.T
smoothed_error = filtered_error - P @ ops.omega @ P
components = {"moment about the joint axis, N·m": 2, "force along x of the link, N": 3, "force along y of the link, N": 4}
bodies = np.arange(len(ops.bodies))
figure, axes = plt.subplots(1, 3, figsize=(9.6, 3.4))
draw = 3
for ax, (label, component) in zip(axes, components.items()):
    at = 6 * bodies + component
    sigma_z = np.sqrt(np.maximum(np.diag(filtered_error.dense())[at], 0))
    sigma_f = np.sqrt(np.maximum(np.diag(smoothed_error.dense())[at], 0))
    ax.errorbar(bodies - 0.1, z[draw, at], sigma_z, fmt="s", ms=4, capsize=3, label="filtered z ± σ")
    ax.errorbar(bodies + 0.1, f[draw, at], sigma_f, fmt="o", ms=4, capsize=3, label="smoothed f ± σ")
    ax.plot(bodies, X[draw, at], "kx", label="X of the field")
    ax.set(xticks=bodies, xticklabels=names, title=label)
axes[0].legend()
figure.suptitle("One draw: about the axes the smoother leaves no error (10.6); forces across them stay uncertain")
save(figure, "random_field_smoother")

# The errors of all draws have these covariances; at the joints H 𝒫 = 0.
scale = np.abs(filtered_error.dense()).max()
tolerance = 6 * scale / np.sqrt(len(X))
assert np.allclose((X - z).T @ (X - z) / len(X), filtered_error.dense(), atol=tolerance)
assert np.allclose((X - f).T @ (X - f) / len(X), smoothed_error.dense(), atol=tolerance)
assert np.abs((H @ smoothed_error).dense()).max() < 1e-12 * scale
print("covariances of X − z and X − f from 100 000 draws agree with ψ M ψ* and ψ M ψ* − P Ω P")
