"""Common cameras, with the part of the sensor that their image shows.

Sizes are pixels times pixel pitch, or the maker's data sheet. Photographs and videos of one camera
differ: many videos show the full width of the sensor and less of its height; where a camera crops
further, its data sheet says so, and its numbers must be typed.

The camera makes a GoPro's Linear mode from its wide image, so that the field of view of the result
counts: that of a 19 mm lens on full frame at its widest. Stabilisation crops further, as it does in
a phone's video. Its Wide mode is a fisheye of 118 degrees across the image. The phone has the main
camera of an iPhone 13 (26 mm on full frame).
"""

from collections.abc import Mapping

from stereocal.field.planning.plan import SensorLens


def _pitch(width: int, height: int, micrometres: float, focal_mm: float) -> SensorLens:
    sensor = (round(width * micrometres / 1000, 4), round(height * micrometres / 1000, 4))
    return SensorLens(focal_mm, sensor, (width, height))


COMMON: Mapping[str, SensorLens] = {
    "IDT M5 (2336 x 1728, 7 µm)": _pitch(2336, 1728, 7.0, 50.0),
    "Photron Mini AX (1024 x 1024, 20 µm)": _pitch(1024, 1024, 20.0, 50.0),
    "Phantom VEO 710 (1280 x 800, 20 µm)": _pitch(1280, 800, 20.0, 50.0),
    "Sony IMX174/249 (1920 x 1200, 5.86 µm)": _pitch(1920, 1200, 5.86, 16.0),
    "Sony IMX273 (1440 x 1080, 3.45 µm)": _pitch(1440, 1080, 3.45, 8.0),
    "Sony IMX252/265 (2048 x 1536, 3.45 µm)": _pitch(2048, 1536, 3.45, 8.0),
    "Sony IMX250/264 (2448 x 2048, 3.45 µm)": _pitch(2448, 2048, 3.45, 12.0),
    "Sony IMX253/304 (4096 x 3000, 3.45 µm)": _pitch(4096, 3000, 3.45, 25.0),
    "Sony IMX226 (4000 x 3000, 1.85 µm)": _pitch(4000, 3000, 1.85, 8.0),
    "Sony IMX183 (5472 x 3648, 2.4 µm)": _pitch(5472, 3648, 2.4, 16.0),
    "ON Python 1300 (1280 x 1024, 4.8 µm)": _pitch(1280, 1024, 4.8, 8.0),
    "Raspberry Pi camera 2 (3280 x 2464)": _pitch(3280, 2464, 1.12, 3.04),
    "Raspberry Pi camera 3 (4608 x 2592)": _pitch(4608, 2592, 1.4, 4.74),
    "Raspberry Pi HQ (4056 x 3040)": _pitch(4056, 3040, 1.55, 6.0),
    "Raspberry Pi global shutter (1456 x 1088)": _pitch(1456, 1088, 3.45, 6.0),
    "Full frame, photographs (6000 x 4000)": SensorLens(50.0, (36.0, 24.0), (6000, 4000)),
    "Full frame, 4K video, full width": SensorLens(50.0, (36.0, 20.25), (3840, 2160)),
    "APS-C, photographs (6000 x 4000)": SensorLens(35.0, (23.5, 15.6667), (6000, 4000)),
    "APS-C, 4K video, full width": SensorLens(35.0, (23.5, 13.2188), (3840, 2160)),
    "APS-C, Full HD video, full width": SensorLens(35.0, (23.5, 13.2188), (1920, 1080)),
    "Micro four thirds, 4K video, full width": SensorLens(25.0, (17.3, 9.7313), (3840, 2160)),
    "1 inch, 4K video, full width": SensorLens(8.8, (13.2, 7.425), (3840, 2160)),
    "GoPro HERO, 4K video, Linear": SensorLens(3.26, (6.17, 3.4706), (3840, 2160)),
    "GoPro HERO, 4K video, Wide": SensorLens(2.99, (6.17, 3.4706), (3840, 2160), "fisheye"),
    "Phone, 1.7 µm, photographs (4032 x 3024)": _pitch(4032, 3024, 1.7, 5.1),
}
"""With the focal length of their own lens, or of a usual one."""
