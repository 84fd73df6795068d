"""Covariance of dependent Gaussian processes: outputs that share white noise, smoothed differently.

Each output is a sum of shared latent processes and one of its own. A latent process is white noise
w_q; output i smooths it with a Gaussian kernel of width ℓ_qi = L_qi/√2 in every input,

    f_i(x) = Σ_q ∫ k_qi(x − z) w_q(z) dz + ∫ h_i(x − z) w'_i(z) dz,

so that the covariances are convolutions in closed form. With P = (L_qi² + L_qj²)/2 elementwise,

    cov[f_i(x), f_j(x')] = Σ_q a_qi a_qj Π_k √(L_qik L_qjk / P_k) exp(−½ Σ_k (x−x')_k² / P_k)
                         + δ_ij b_i² M(x−x').

The amplitudes a may be negative: coefficients that fall where another rises. Kernels are scaled so
that a² and b² are variances. Unequal length-scales bound the correlation of two outputs by the
product under the root, which falls quickly with the number of inputs; `tied` ones do not. With
tied ones, as for an output's own process, any correlation is such a convolution, and it need not
be the Gaussian, whose functions have all derivatives: at the break of a stall they are too sure of
themselves. There it is Matérn's, of functions with two derivatives, with r² = Σ_k (x−x')_k²/L_k²

    M = (1 + √5 r + 5r²/3) exp(−√5 r).

References:
    P. Boyle, M. Frean, "Dependent Gaussian processes", NIPS 17, 2005; M. A. Álvarez, N. D.
    Lawrence, "Computationally efficient convolved multiple output Gaussian processes", JMLR 12,
    2011; C. E. Rasmussen, C. K. I. Williams, "Gaussian processes for machine learning", 2006,
    equation 4.17 (ν = 5/2).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from gcs_sysid.frames import Array


class Kernel(NamedTuple):
    """Amplitudes and length-scales of all processes, in the units of scaled inputs and outputs.

    Attributes:
        amplitude: a, of each shared latent process in each output; signed.
        scale: L, length-scale of the covariance a latent process alone gives an output; with one
            row for all outputs they are tied.
        own_amplitude: b, of each output's own process.
        own_scale: M, its length-scales.
    """

    amplitude: Float[Array, "latent output"]
    scale: Float[Array, "latent row input"]
    own_amplitude: Float[Array, " output"]
    own_scale: Float[Array, "output input"]

    @property
    def tied(self) -> bool:
        """Whether all outputs share the length-scales of each latent process."""
        return self.scale.shape[1] == 1


class Points(NamedTuple):
    """Values of single outputs: where, and of which output."""

    inputs: Float[Array, "point input"]
    output: Int[Array, " point"]


def variance(kernel: Kernel) -> Float[Array, " output"]:
    """Prior variance of each output."""
    return jnp.sum(kernel.amplitude**2, axis=0) + kernel.own_amplitude**2


def covariance(kernel: Kernel, left: Points, right: Points) -> Float[Array, "left right"]:
    """Covariance of every point of `left` with every one of `right`."""
    same = (left.output[:, None] == right.output[None, :]).astype(left.inputs.dtype)
    total = _own(kernel, left.inputs, right) * same
    for amplitude, scale in zip(kernel.amplitude, kernel.scale, strict=True):
        size = amplitude[left.output][:, None] * amplitude[right.output][None, :]
        if kernel.tied:
            total = total + size * _alike(left.inputs, right.inputs, scale[0])
        else:
            total = total + size * _smoothed(
                left.inputs, right.inputs, scale[left.output], scale[right.output]
            )
    return total


def covariance_of_all(
    kernel: Kernel, inputs: Float[Array, "sample input"], points: Points
) -> Float[Array, "sample output point"]:
    """Covariance of every output at every sample with every point."""
    same = outputs_of(kernel, points)
    if kernel.tied:
        shared, own = parts(kernel, inputs, points)
        total = own[:, None, :] * same.T[None, :, :]
        for amplitude, part in zip(kernel.amplitude, shared, strict=True):
            total = total + amplitude[None, :, None] * part[:, None, :]
        return total
    total = _own(kernel, inputs, points)[:, None, :] * same.T[None, :, :]
    for amplitude, scale in zip(kernel.amplitude, kernel.scale, strict=True):
        size = amplitude[:, None] * amplitude[points.output][None, :]
        rows = [
            _smoothed(
                inputs,
                points.inputs,
                jnp.broadcast_to(one[None, :], inputs.shape),
                scale[points.output],
            )
            for one in scale
        ]
        total = total + size[None, :, :] * jnp.stack(rows, axis=1)
    return total


def parts(
    kernel: Kernel, inputs: Float[Array, "sample input"], points: Points
) -> tuple[Float[Array, "latent sample point"], Float[Array, "sample point"]]:
    """What the covariances of all outputs with the points are made of, length-scales tied.

    Output i has Σ_q a_qi·shared_q, and, with points of its own, `own` besides: six outputs cost
    little more than one.
    """
    shared = [
        amplitude[points.output][None, :] * _alike(inputs, points.inputs, scale[0])
        for amplitude, scale in zip(kernel.amplitude, kernel.scale, strict=True)
    ]
    empty = jnp.zeros((0, inputs.shape[0], points.inputs.shape[0]))
    return jnp.stack(shared) if shared else empty, _own(kernel, inputs, points)


def outputs_of(kernel: Kernel, points: Points) -> Float[Array, "point output"]:
    """1 where a point is of an output."""
    outputs = jnp.arange(kernel.own_amplitude.shape[0])
    same = jnp.asarray(points.output)[:, None] == outputs[None, :]
    return same.astype(kernel.own_amplitude.dtype)


def _own(
    kernel: Kernel, inputs: Float[Array, "left input"], points: Points
) -> Float[Array, "left right"]:
    """Covariance by the own process of each point's output, as if all were of that output.

    (x−z)²/M² is written out as three products of matrices, because M changes with the point.
    """
    precision = kernel.own_scale[points.output] ** -2.0
    centre = jnp.mean(points.inputs, axis=0)[None, :]
    left, right = inputs - centre, points.inputs - centre
    square = (
        left**2 @ precision.T
        - 2.0 * left @ (right * precision).T
        + jnp.sum(right**2 * precision, axis=1)[None, :]
    )
    size = kernel.own_amplitude[points.output] ** 2
    return size[None, :] * _matern(square)


def _alike(
    left: Float[Array, "left input"],
    right: Float[Array, "right input"],
    scale: Float[Array, " input"],
) -> Float[Array, "left right"]:
    centre = jnp.mean(right, axis=0)[None, :]
    here, there = (left - centre) / scale[None, :], (right - centre) / scale[None, :]
    square = (
        jnp.sum(here**2, axis=1)[:, None]
        + jnp.sum(there**2, axis=1)[None, :]
        - 2.0 * here @ there.T
    )
    return _matern(square)


@jax.custom_jvp
def _matern(square: Float[Array, "*point"]) -> Float[Array, "*point"]:
    """Matérn's correlation of order 5/2 by the squared distance, which rounding may leave below 0.

    Its derivatives by the square are written out: they have limits at 0, where that of the root
    has none.
    """
    root = _root(square)
    return (1.0 + root + root**2 / 3.0) * jnp.exp(-root)


@_matern.defjvp
def _matern_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (square,), (change,) = primals, tangents
    return _matern(square), _falling(square) * change


@jax.custom_jvp
def _falling(square: Float[Array, "*point"]) -> Float[Array, "*point"]:
    """Derivative of `_matern`."""
    root = _root(square)
    return -5.0 / 6.0 * (1.0 + root) * jnp.exp(-root)


@_falling.defjvp
def _falling_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (square,), (change,) = primals, tangents
    return _falling(square), 25.0 / 12.0 * jnp.exp(-_root(square)) * change


def _root(square: Float[Array, "*point"]) -> Float[Array, "*point"]:
    """√5 times the distance."""
    return jnp.sqrt(5.0 * jnp.maximum(square, 0.0))


def _smoothed(
    left: Float[Array, "left input"],
    right: Float[Array, "right input"],
    left_scale: Float[Array, "left input"],
    right_scale: Float[Array, "right input"],
) -> Float[Array, "left right"]:
    """Convolution of two Gaussian kernels of unit variance; summed input by input."""
    exponent = jnp.zeros((left.shape[0], right.shape[0]))
    for column in range(left.shape[1]):
        here, there = left_scale[:, column][:, None], right_scale[:, column][None, :]
        width = 0.5 * (here**2 + there**2)
        apart = left[:, column][:, None] - right[:, column][None, :]
        exponent = exponent + 0.5 * jnp.log(here * there / width) - 0.5 * apart**2 / width
    return jnp.exp(exponent)
