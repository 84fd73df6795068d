"""The flight model: one differentiable description of the whole measurement chain."""
