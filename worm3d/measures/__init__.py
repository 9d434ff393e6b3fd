"""Measures of a run: the table of measures, and the functions that compute them.

The order of the imports is the order of the measures in a summary.
"""

from worm3d.measures.table import MEASURES as MEASURES
from worm3d.measures.table import Measure as Measure
from worm3d.measures.table import Metric as Metric
from worm3d.measures.table import NoValueError as NoValueError
from worm3d.measures.table import enter_figures as enter_figures
from worm3d.measures.table import measure as measure
from worm3d.measures.table import reasons as reasons
from worm3d.measures.table import summary as summary

# isort: split
from worm3d.measures import general as general

# isort: split
from worm3d.measures import gait as gait

# isort: split
from worm3d.measures import actuation as actuation

# isort: split
from worm3d.measures import contact as contact

# isort: split
from worm3d.measures import stability as stability

# isort: split
from worm3d.measures import segment_law as segment_law
