"""Worms as Gymnasium environments, under the name for import by agents: `scenes.studies.learn.environment`."""

from scenes.studies.learn.environment import WormEnv as WormEnv
from scenes.studies.learn.environment import WormVectorEnv as WormVectorEnv
