"""Chi-square distribution by SciPy's incomplete gamma function, imported on first use."""


def chance(chi_square: float, freedom: float) -> float:
    """Probability of a larger chi-square by chance with ``freedom`` degrees of freedom; 1 with none."""
    if freedom <= 0:
        return 1.0
    from scipy.special import gammaincc

    return float(gammaincc(freedom / 2, chi_square / 2))


def limit(probability: float, freedom: float) -> float:
    """Chi-square that is exceeded with this probability; 0 without degrees of freedom."""
    if freedom <= 0:
        return 0.0
    from scipy.special import gammainccinv

    return 2 * float(gammainccinv(freedom / 2, probability))
