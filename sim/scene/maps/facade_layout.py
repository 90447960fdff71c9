"""Layout of the textures of buildings: heights, rows, bands and windows in them."""

WALL_M = 12.0  # height of the textures of walls: four storeys of 3 m; their width is 12 m, that of brick 6 m
STOREY_M = 3.0
SHOPS_V = 0.5  # the lower half of `trim` shows two shop windows
# Rows of the texture `trim`, from the top; its image is 1 m wide and each row shows one material.
TRIM_ROWS = (
    "white", "anthracite", "brown", "stone", "concrete", "cream", "door_green", "door_red", "door_blue", "timber",
    "awning_red", "awning_green", "sign_bakery", "sign_pharmacy", "sign_books", "brick",
)  # fmt: skip
BANDS = ("plinth", "stone", "cream", "dark")  # bands in the textures of walls, at the lines between their storeys
# Windows of blocks of flats, whose walls have holes there: width, sill and head [m], in whole texels.
TEXEL_M = WALL_M / 512
WINDOW_M = (56 * TEXEL_M, 38 * TEXEL_M, 102 * TEXEL_M)
OFFICE_WINDOW_M = (108 * TEXEL_M, 26 * TEXEL_M, 106 * TEXEL_M)
PANES = 4  # the texture `panes` holds 4 x 4 windows
# Textures `facade_STYLE_...` of imported buildings: bays of 3 m, and storeys of the upper one.
BAYS, STOREYS = 4, 2
WHITE_WALL_RGB = (0.83, 0.82, 0.79)
