"""Exact factors between SI and the units that JSBSim computes in.

JSBSim's own conversions of XML units are rounded (1 kg·m² is off by 9e-5), so models are written in
its native units with these instead. By definition: NIST SP 811 (2008), appendix B.8.
"""

from __future__ import annotations

FOOT = 0.3048
"""[m]"""
INCH = FOOT / 12.0
"""[m]"""
POUND_FORCE = 4.4482216152605
"""[N]"""
SLUG = POUND_FORCE / FOOT
"""[kg]"""
SLUG_FOOT2 = SLUG * FOOT**2
"""[kg·m²]"""
PSF = POUND_FORCE / FOOT**2
"""[Pa]"""
SLUG_FOOT3 = SLUG / FOOT**3
"""[kg/m³]"""
RANKINE = 5.0 / 9.0
"""[K]"""
JSBSIM_SLUG_WEIGHT = 32.174049
"""Weight that JSBSim gives a slug when it turns `emptywt` into mass [lbf] (FGJSBBase::slugtolb)."""
