"""Whom a paper must cite: the sources of laws, methods and named media, each written once."""

from __future__ import annotations

import re
from typing import NamedTuple

from cavirheo.physics.materials import LAWS

_DOI = re.compile(r"doi:(\S+?)[.,;)]*(?=\s|$)")  # in the docstring of a law


class Source(NamedTuple):
    """authors, title and where (the journal) are written for BibTeX; `where` of what is not an article begins with
    arXiv, report or version."""

    authors: str
    year: str
    title: str
    where: str
    doi: str

    @property
    def key(self) -> str:
        """Estrada2018; of the program, cavirheo2026."""
        return ("cavirheo" if self.authors[0] == "{" else re.split(r"[ ,]", self.authors)[0]) + self.year

    @property
    def bibtex(self) -> str:
        named = {"author": self.authors, "year": self.year, "title": self.title, "journal": self.where, "doi": self.doi}
        kind = "misc" if self.where.startswith(("arXiv", "report", "version")) else "article"
        named = {("note" if kind == "misc" and name == "journal" else name): text for name, text in named.items()}
        lines = [f"  {name} = {{{text}}}" for name, text in named.items() if text]
        return f"@{kind}{{{self.key},\n" + ",\n".join(lines) + "\n}"


IMR = Source(
    "Estrada, J. B. and Barajas, C. and Henann, D. L. and Johnsen, E. and Franck, C.", "2018",
    "High strain-rate soft material characterization via inertial cavitation",
    "Journal of the Mechanics and Physics of Solids", "10.1016/j.jmps.2017.12.006",
)  # fmt: skip
MOTION = {  # by equation of the wall
    "keller-miksis": Source(
        "Keller, J. B. and Miksis, M.",
        "1980",
        "Bubble oscillations of large amplitude",
        "The Journal of the Acoustical Society of America",
        "10.1121/1.384720",
    ),
    "rayleigh-plesset": Source(
        "Plesset, M. S.",
        "1949",
        "The dynamics of cavitation bubbles",
        "Journal of Applied Mechanics",
        "10.1115/1.4009975",
    ),
    "gilmore": Source(
        "Gilmore, F. R.",
        "1952",
        "The growth or collapse of a spherical bubble in a viscous compressible liquid",
        "report 26-4, Hydrodynamics Laboratory, California Institute of Technology",
        "",
    ),
}
DIFFUSIVITY = Source(
    "Fuller, E. N. and Schettler, P. D. and Giddings, J. C.", "1966",
    "New method for prediction of binary gas-phase diffusion coefficients", "Industrial and Engineering Chemistry",
    "10.1021/ie50677a007",
)  # fmt: skip
BDT = Source(
    "Bu, L. and Yu, Z. and Lin, S. and Fuhg, J. N. and Yang, J.", "2025",
    "Bubble Dynamics Transformer: Microrheology at Ultra-High Strain Rates", "arXiv:2506.11936", "",
)  # fmt: skip
SAMPLING = Source(
    "Cornuet, J.-M. and Marin, J.-M. and Mira, A. and Robert, C. P.", "2012", "Adaptive multiple importance sampling",
    "Scandinavian Journal of Statistics", "10.1111/j.1467-9469.2011.00756.x",
)  # fmt: skip
DISCREPANCY = Source(
    "Kennedy, M. C. and O'Hagan, A.", "2001", "{Bayesian} calibration of computer models",
    "Journal of the Royal Statistical Society: Series B", "10.1111/1467-9868.00294",
)  # fmt: skip
EVIDENCE = Source(
    "Kass, R. E. and Raftery, A. E.", "1995", "{Bayes} factors", "Journal of the American Statistical Association",
    "10.1080/01621459.1995.10476572",
)  # fmt: skip
POPULATION = Source(
    "Hogg, D. W. and Myers, A. D. and Bovy, J.", "2010", "Inferring the eccentricity distribution",
    "The Astrophysical Journal", "10.1088/0004-637X/725/2/2166",
)  # fmt: skip
QUADRATIC = Source(
    "Yang, J. and Cramer, III, H. C. and Franck, C.", "2020",
    "Extracting non-linear viscoelastic material properties from violently-collapsing cavitation bubbles",
    "Extreme Mechanics Letters", "10.1016/j.eml.2020.100839",
)  # fmt: skip
COLLAPSE_TIME = Source(
    "Zhu, Z. and Remillard, S. and Abeid, B. A. and Frolkin, D. and Bryngelson, S. H. and Yang, J. and "
    "Rodriguez, Jr., M. and Estrada, J. B.", "2025",
    "Parsimonious inertial cavitation rheometry via bubble collapse time", "Soft Matter", "10.1039/D5SM00397K",
)  # fmt: skip
_OF_LAWS = (
    IMR, QUADRATIC,
    Source("Yang, X. and Church, C. C.", "2005", "A model for the dynamics of gas bubbles in soft tissue",
           "The Journal of the Acoustical Society of America", "10.1121/1.2118307"),
    Source("Gaudron, R. and Warnez, M. T. and Johnsen, E.", "2015",
           "Bubble dynamics in a viscoelastic medium with nonlinear elasticity", "Journal of Fluid Mechanics",
           "10.1017/jfm.2015.7"),
    Source("Mooney, M.", "1940", "A theory of large elastic deformation", "Journal of Applied Physics",
           "10.1063/1.1712836"),
    Source("Rivlin, R. S.", "1948",
           "Large elastic deformations of isotropic materials {IV}. {F}urther developments of the general theory",
           "Philosophical Transactions of the Royal Society of London. Series A", "10.1098/rsta.1948.0024"),
    Source("Yeoh, O. H.", "1993", "Some forms of the strain energy function for rubber",
           "Rubber Chemistry and Technology", "10.5254/1.3538343"),
    Source("Fung, Y. C.", "1967", "Elasticity of soft tissues in simple elongation",
           "American Journal of Physiology", "10.1152/ajplegacy.1967.213.6.1532"),
    Source("Gent, A. N.", "1996", "A new constitutive relation for rubber", "Rubber Chemistry and Technology",
           "10.5254/1.3538357"),
    Source("Arruda, E. M. and Boyce, M. C.", "1993",
           "A three-dimensional constitutive model for the large stretch behavior of rubber elastic materials",
           "Journal of the Mechanics and Physics of Solids", "10.1016/0022-5096(93)90013-6"),
    Source("Ogden, R. W.", "1972",
           "Large deformation isotropic elasticity -- on the correlation of theory and experiment for incompressible "
           "rubberlike solids", "Proceedings of the Royal Society of London. Series A", "10.1098/rspa.1972.0026"),
    Source("Ostwald, W.", "1925",
           r'{{\"U}ber die Geschwindigkeitsfunktion der Viskosit{\"a}t disperser Systeme. I}', "Kolloid-Zeitschrift",
           "10.1007/BF01431449"),
    Source("Herschel, W. H. and Bulkley, R.", "1926", r'{Konsistenzmessungen von Gummi-Benzoll{\"o}sungen}',
           "Kolloid-Zeitschrift", "10.1007/BF01432034"),
    Source("Bercovier, M. and Engelman, M.", "1980",
           "A finite element method for incompressible non-{Newtonian} flows", "Journal of Computational Physics",
           "10.1016/0021-9991(80)90163-1"),
    Source("Carreau, P. J.", "1972", "Rheological equations from molecular network theories",
           "Transactions of the Society of Rheology", "10.1122/1.549276"),
    Source("Yasuda, K. and Armstrong, R. C. and Cohen, R. E.", "1981",
           "Shear flow properties of concentrated solutions of linear and star branched polystyrenes",
           "Rheologica Acta", "10.1007/BF01513059"),
    Source("Cross, M. M.", "1965", "Rheology of non-{Newtonian} fluids: a new flow equation for pseudoplastic systems",
           "Journal of Colloid Science", "10.1016/0095-8522(65)90022-X"),
    Source("Powell, R. E. and Eyring, H.", "1944", "Mechanisms for the relaxation theory of viscosity", "Nature",
           "10.1038/154427a0"),
    Source("Allen, J. S. and Roy, R. A.", "2000",
           "Dynamics of gas bubbles in viscoelastic fluids. {I}. {L}inear viscoelasticity",
           "The Journal of the Acoustical Society of America", "10.1121/1.429344"),
    Source("Warnez, M. T. and Johnsen, E.", "2015",
           "Numerical modeling of bubble dynamics in viscoelastic media with relaxation", "Physics of Fluids",
           "10.1063/1.4922598"),
    Source("Oldroyd, J. G.", "1950", "On the formulation of rheological equations of state",
           "Proceedings of the Royal Society of London. Series A", "10.1098/rspa.1950.0035"),
    Source("Hua, C. and Johnsen, E.", "2013",
           "Nonlinear oscillations following the {Rayleigh} collapse of a gas bubble in a linear viscoelastic "
           "(tissue-like) medium", "Physics of Fluids", "10.1063/1.4817673"),
)  # fmt: skip
_BY_DOI = {source.doi: source for source in _OF_LAWS}
MEDIA = {"bu2026": BDT, "estrada2018": IMR, "zhu2025": COLLAPSE_TIME, "yang2020": QUADRATIC}  # by name of the set


def of_law(name: str) -> list[Source]:
    """Those that the docstring of a law gives, by their DOI; none of a name that is no law."""
    return [_BY_DOI[doi] for doi in _DOI.findall(getattr(LAWS.get(name), "__doc__", None) or "")]
