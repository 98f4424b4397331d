"""Draws README's head picture: a volume by four programs, side by side.

    cargo run --release --example write -- demo:nautilus nautilus.mha
    voxsplat render demo:nautilus -o voxsplat.png --save-transfer nautilus.vp
    pip install vtk==9.7.2 pyvista==0.49.1 f3d==4.0.0 pillow
    python docs/beside.py nautilus.mha voxsplat.png nautilus.vp docs/beside.png

VTK gets the transfer function of voxsplat, as a volume property of 3D Slicer, and shades it. voxsplat, PyVista and F3D
draw by their defaults.
"""

import sys

import f3d
import pyvista
import vtk
from PIL import Image, ImageDraw, ImageFont

SIZE = 1024
# Width and height of a panel; the picture of 1024 pixels shrinks to the width.
PANEL, HEIGHT = 400, 340
# The view of voxsplat, from azimuth 22 and elevation 12: towards the eye, in x, y and z.
TOWARDS = (0.366, -0.907, 0.208)


def read_property(path):
    """A volume property of 3D Slicer (.vp), with its light, which Slicer's presets use."""
    lines = [line.split() for line in open(path)]
    diffuse, ambient, specular, power = (float(lines[at][0]) for at in (2, 3, 4, 5))
    opacities, colours = ([float(word) for word in lines[at][1:]] for at in (6, 8))
    prop = vtk.vtkVolumeProperty()
    opacity, colour = vtk.vtkPiecewiseFunction(), vtk.vtkColorTransferFunction()
    for at in range(0, len(opacities), 2):
        opacity.AddPoint(*opacities[at : at + 2])
    for at in range(0, len(colours), 4):
        colour.AddRGBPoint(*colours[at : at + 4])
    prop.SetScalarOpacity(opacity)
    prop.SetColor(colour)
    prop.SetInterpolationTypeToLinear()
    prop.ShadeOn()
    prop.SetDiffuse(diffuse)
    prop.SetAmbient(ambient)
    prop.SetSpecular(specular)
    prop.SetSpecularPower(power)
    return prop


def by_vtk(volume, prop, picture):
    """The default mapper, shaded."""
    reader = vtk.vtkMetaImageReader()
    reader.SetFileName(volume)
    mapper = vtk.vtkSmartVolumeMapper()
    mapper.SetInputConnection(reader.GetOutputPort())
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.SetProperty(read_property(prop))
    renderer = vtk.vtkRenderer()
    renderer.AddVolume(actor)
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    window.SetSize(SIZE, SIZE)
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(*TOWARDS)
    camera.SetViewUp(0, 0, 1)
    renderer.ResetCamera()
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    writer = vtk.vtkPNGWriter()
    writer.SetFileName(picture)
    writer.SetInputConnection(grab.GetOutputPort())
    writer.Write()


def by_pyvista(volume, picture):
    """`add_volume` without options."""
    plotter = pyvista.Plotter(off_screen=True, window_size=(SIZE, SIZE))
    plotter.add_volume(pyvista.read(volume), show_scalar_bar=False)
    plotter.camera_position = [TOWARDS, (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera()
    plotter.screenshot(picture)


def by_f3d(volume, picture):
    """The volume mode, which colours by value."""
    f3d.Engine.autoload_plugins()
    engine = f3d.Engine.create(True)
    engine.options.update({"model.volume.enable": True, "model.coloring": "scivis", "scene.up_direction": "+Z"})
    engine.scene.add(volume)
    engine.window.size = SIZE, SIZE
    camera = engine.window.camera
    camera.focal_point, camera.view_up, camera.position = (0, 0, 0), (0, 0, 1), TOWARDS
    camera.reset_to_bounds()
    engine.window.render_to_image().save(picture)


def main(volume, voxsplat, prop, figure):
    by_vtk(volume, prop, "vtk.png")
    by_pyvista(volume, "pyvista.png")
    by_f3d(volume, "f3d.png")
    panels = [
        (voxsplat, "voxsplat"),
        ("vtk.png", f"VTK {vtk.VTK_VERSION}, shaded"),
        ("pyvista.png", f"PyVista {pyvista.__version__}"),
        ("f3d.png", "F3D 4.0.0"),
    ]
    sheet = Image.new("RGB", (PANEL * len(panels), HEIGHT + 36), "black")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(18)
    for at, (picture, name) in enumerate(panels):
        panel = Image.open(picture).convert("RGB").resize((PANEL, PANEL), Image.LANCZOS)
        top = (PANEL - HEIGHT) // 2
        sheet.paste(panel.crop((0, top, PANEL, top + HEIGHT)), (at * PANEL, 0))
        draw.text((at * PANEL + PANEL / 2, HEIGHT + 16), name, "white", font, anchor="mm")
    sheet.save(figure, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
