"""Makes the transfer functions of other programs in this folder, and what VTK says of them: expected.json.

python make.py, with vtk and numpy. The files are in the formats that the programs write; colours and opacities are found
by vtkColorTransferFunction and vtkPiecewiseFunction, those of niivue and napari by linear interpolation.
"""

import json
import pathlib

import numpy
import vtk

HERE = pathlib.Path(__file__).parent
EXPECTED = {}
COOL_TO_WARM = [0, 0.231373, 0.298039, 0.752941, 0.5, 0.865003, 0.865003, 0.865003, 1, 0.705882, 0.0156863, 0.14902]
ENDS = [-2, 0.1, 0.2, 0.9, 1, 0.9, 0.5, 0.1, 2, 0.2, 0.1, 0.2]
POINTS = [-1000, 0, 0.5, 0, 100, 0.1, 0.3, 0.5, 300, 0.6, 0.5, 1, 400, 0.2, 0.8, 0.2, 1000, 0.9, 0.5, 0]


def colors(points, space="RGB", wrap=False):
    function = vtk.vtkColorTransferFunction()
    {"RGB": function.SetColorSpaceToRGB, "HSV": function.SetColorSpaceToHSV, "Lab": function.SetColorSpaceToLab,
     "Diverging": function.SetColorSpaceToDiverging, "Step": function.SetColorSpaceToStep}[space]()
    function.SetHSVWrap(wrap)
    for point in points:
        function.AddRGBPoint(*point)
    return function


def opacities(points):
    function = vtk.vtkPiecewiseFunction()
    for point in points:
        function.AddPoint(*point)
    return function


def groups(numbers, n):
    return [numbers[i:i + n] for i in range(0, len(numbers), n)]


def expect(name, color, opacity, low, high, **more):
    """Samples between the points, on either side of a step. Colours without opacities are over places from 0 to 1."""
    values = numpy.linspace(low, high, 57) + (high - low) * 1.7e-4
    place = lambda v: float(v if opacity else (v - low) / (high - low))
    rows = [[place(v), *(color.GetColor(v) if color else [1, 1, 1]),
             opacity.GetValue(v) if opacity else None] for v in values[:-1]]
    EXPECTED[name] = {"rows": [[None if x is None else round(x, 6) for x in row] for row in rows], **more}


def write(name, text):
    (HERE / name).write_text(text)


def paraview():
    presets = []
    for name, space, points, wrap in [
        ("Cool to Warm", "Diverging", COOL_TO_WARM[:4] + COOL_TO_WARM[8:], False), ("Lab", "Lab", ENDS, False),
        ("HSV", "HSV", ENDS, False), ("HSV wrapped", "HSV", ENDS, True), ("Steps", "Step", ENDS, False),
    ]:
        preset = {"ColorSpace": space, "Creator": "make.py", "Name": name, "RGBPoints": points,
                  "NanColor": [1, 1, 0]}
        presets.append(preset | ({"HSVWrap": 1} if wrap else {}))
        xs = points[::4]
        expect(f"paraview.json#{name}", colors(groups(points, 4), space, wrap), None, xs[0], xs[-1], fits=True)
    write("paraview.json", json.dumps(presets, indent=1) + "\n")
    rgb = [-1000, 0, 0, 0.2, 200, 1, 0.5, 0, 1000, 1, 1, 1]
    write("paraview-opacity.json", json.dumps([{"ColorSpace": "RGB", "Name": "Shaped", "RGBPoints": rgb,
                                                "Points": POINTS}], indent=1) + "\n")
    expect("paraview-opacity.json", colors(groups(rgb, 4)), opacities(groups(POINTS, 4)), -1000, 1000, mean=True)
    rows = "\n".join(f'    <Point x="{x}" o="1" r="{r}" g="{g}" b="{b}"/>' for x, r, g, b in groups(COOL_TO_WARM, 4))
    ends = "\n".join(f'    <Point x="{x}" o="1" r="{r}" g="{g}" b="{b}"/>' for x, r, g, b in groups(ENDS, 4))
    write("colormaps.xml", f'<ColorMaps>\n  <ColorMap name="Straight" space="RGB">\n{rows}\n    <NaN r="1" g="1" b="0"/>\n'
          f'  </ColorMap>\n  <ColorMap name="Round &amp; back" space="Wrapped">\n{ends}\n  </ColorMap>\n</ColorMaps>\n')
    expect("colormaps.xml#Straight", colors(groups(COOL_TO_WARM, 4)), None, 0, 1, fits=True)
    expect("colormaps.xml#Round & back", colors(groups(ENDS, 4), "HSV", True), None, -2, 2, fits=True)


def slicer():
    opacity = [-3024, 0, -16.4458, 0, 641.385, 0.715686, 3071, 0.705882]
    color = [-3024, 0, 0, 0, -16.4458, 0.729412, 0.254902, 0.301961, 641.385, 0.905882, 0.815686, 0.552941, 3071, 1, 1, 1]
    gradient = [0, 0, 40, 0.25, 255, 1]
    found = colors(groups(color, 4)), opacities(groups(opacity, 2)), -3024, 3071
    counted = lambda numbers: " ".join(map(str, [len(numbers), *numbers]))
    write("slicer.vp", f"1\n1\n0.9\n0.1\n0.2\n10\n{counted(opacity)}\n4 0 1 255 1\n{counted(color)}\n")
    expect("slicer.vp", *found, mean=True, material=[0.1, 0.9, 0.2, 10])
    element = lambda name, shade, gradient: (
        f'  <VolumeProperty name="{name}" gradientOpacity="{counted(gradient)}" specularPower="10" '
        f'scalarOpacity="{counted(opacity)}" specular="0.2" shade="{shade}" ambient="0.1" '
        f'colorTransfer="{counted(color)}" diffuse="0.9" interpolation="1"/>\n')
    write("presets.xml", '<?xml version="1.0" encoding="utf-8"?>\n<MRML>\n' + element("CT-Bone", 0, [0, 1, 255, 1])
          + element("CT-Edges", 1, gradient) + "</MRML>\n")
    expect("presets.xml#CT-Bone", *found, mean=True)
    expect("presets.xml#CT-Edges", *found, mean=True, gradient=True, material=[0.1, 0.9, 0.2, 10])
    point = lambda x, **more: {"x": x, **more, "midpoint": 0.5, "sharpness": 0.0}
    shaped = [{"x": x, "y": y, "midpoint": m, "sharpness": s} for x, y, m, s in groups(POINTS, 4)]
    component = {
        "componentWeight": 1.0, "shade": True,
        "lighting": {"diffuse": 1.0, "ambient": 0.2, "specular": 0.0, "specularPower": 1.0},
        "disableGradientOpacity": False, "scalarOpacityUnitDistance": 1.5,
        "rgbTransferFunction": {"type": "colorTransferFunction",
                                "points": [point(x, color=[r, g, b]) for x, r, g, b in groups(color, 4)]},
        "scalarOpacity": {"type": "piecewiseFunction", "points": shaped},
        "gradientOpacity": {"type": "piecewiseFunction", "points": [point(0, y=1.0), point(255, y=1.0)]},
    }
    write("slicer.vp.json", json.dumps({"@schema": "volume-property-schema-v1.0.0.json#", "volumeProperties": [
        {"effectiveRange": [-1000, 1000], "isoSurfaceValues": [0.0], "independentComponents": True,
         "interpolationType": "linear", "components": [component]}]}, indent=1) + "\n")
    expect("slicer.vp.json", found[0], opacities(groups(POINTS, 4)), -1000, 1000, unit=1.5, material=[0.2, 1, 0, 1])


class Lines:
    """Linear interpolation, with the methods of VTK."""

    def __init__(self, places, values):
        self.places, self.values = places, numpy.asarray(values, float)

    def GetColor(self, value):
        return [float(numpy.interp(value, self.places, self.values[:, c])) for c in range(3)]

    def GetValue(self, value):
        return float(numpy.interp(value, self.places, self.values))


def maps():
    skull = {"min": 140, "max": 1024, "R": [0, 2, 113, 255], "G": [0, 1, 109, 250], "B": [0, 1, 101, 245],
             "A": [0, 1, 96, 168], "I": [0, 1, 128, 255]}
    write("niivue.json", json.dumps(skull) + "\n")
    places = [140 + i / 255 * (1024 - 140) for i in skull["I"]]
    rgb = numpy.array([skull[c] for c in "RGB"]).T / 255
    expect("niivue.json", Lines(places, rgb), Lines(places, numpy.array(skull["A"]) / 255), 140, 1024, mean=True)
    warm = {"R": [0, 255, 255], "G": [10, 120, 255], "B": [40, 0, 200], "A": [0, 64, 128], "I": [0, 64, 255]}
    write("niivue-map.json", json.dumps(warm) + "\n")
    places = [i / 255 for i in warm["I"]]
    rgb = numpy.array([warm[c] for c in "RGB"]).T / 255
    expect("niivue-map.json", Lines(places, rgb), Lines(places, numpy.array(warm["A"]) / 255), 0, 1, fits=True, mean=True)
    colors = [[0, 0, 0, 1], [0.2, 0.8, 0.1, 1], [1, 1, 1, 1]]
    write("napari.json", json.dumps({"colors": colors, "name": "green", "display_name": "green",
                                     "interpolation": "linear", "controls": [0, 0.7, 1]}) + "\n")
    expect("napari.json", Lines([0, 0.7, 1], colors), None, 0, 1, fits=True)


paraview()
slicer()
maps()
lines = [f"{json.dumps(name)}: {json.dumps(value)}" for name, value in EXPECTED.items()]
write("expected.json", "{\n" + ",\n".join(lines) + "\n}\n")
