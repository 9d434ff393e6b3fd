"""Worms as environments of Gymnasium, by the name that agents import: `scenes.studies.learn.environment`."""

from scenes.studies.learn.environment import WormEnv as WormEnv
from scenes.studies.learn.environment import WormVectorEnv as WormVectorEnv
