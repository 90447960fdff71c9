"""Trees, bushes and hedges: leaf cards round branches from a growth model, six species of trees, four seasons.

What is drawn is not what is solid: trunk and crown are solid capsules, ellipsoids and hulls that are not drawn, and a
vehicle cannot fly through a crown, although cameras and LiDARs see through its gaps.
"""

from sim.scene.maps.plants.materials import plant_materials
from sim.scene.maps.plants.trees import add_bush, add_hedge, add_tree

__all__ = ["add_bush", "add_hedge", "add_tree", "plant_materials"]
