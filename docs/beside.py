"""Draws README's head picture: a volume by voxsplat, VTK and F3D, each by its defaults, side by side.

    cargo run --release --example write -- demo:nautilus nautilus.mha
    voxsplat render demo:nautilus -o voxsplat.png
    pip install vtk==9.7.2 f3d==4.0.0 pillow
    python docs/beside.py nautilus.mha voxsplat.png docs/beside.png
"""

import sys

import f3d
import vtk
from PIL import Image, ImageDraw, ImageFont

SIZE = 1024
# Width and height of a panel; the picture of 1024 pixels shrinks to the width.
PANEL, HEIGHT = 480, 400
# The view of voxsplat, from azimuth 22 and elevation 12: towards the eye, in x, y and z.
TOWARDS = (0.366, -0.907, 0.208)


def by_vtk(volume, picture):
    """The default mapper and property, whose linear ramps span the range of values."""
    reader = vtk.vtkMetaImageReader()
    reader.SetFileName(volume)
    reader.Update()
    low, high = reader.GetOutput().GetScalarRange()
    opacity, grey = vtk.vtkPiecewiseFunction(), vtk.vtkPiecewiseFunction()
    for function in (opacity, grey):
        function.AddPoint(low, 0)
        function.AddPoint(high, 1)
    mapper = vtk.vtkSmartVolumeMapper()
    mapper.SetInputConnection(reader.GetOutputPort())
    actor = vtk.vtkVolume()
    actor.SetMapper(mapper)
    actor.GetProperty().SetScalarOpacity(opacity)
    actor.GetProperty().SetColor(grey)
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


def main(volume, voxsplat, figure):
    by_vtk(volume, "vtk.png")
    by_f3d(volume, "f3d.png")
    panels = [(voxsplat, "voxsplat"), ("vtk.png", f"VTK {vtk.VTK_VERSION}"), ("f3d.png", "F3D 4.0.0")]
    sheet = Image.new("RGB", (PANEL * len(panels), HEIGHT + 36), "black")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(20)
    for at, (picture, name) in enumerate(panels):
        panel = Image.open(picture).convert("RGB").resize((PANEL, PANEL), Image.LANCZOS)
        top = (PANEL - HEIGHT) // 2
        sheet.paste(panel.crop((0, top, PANEL, top + HEIGHT)), (at * PANEL, 0))
        draw.text((at * PANEL + PANEL / 2, HEIGHT + 16), name, "white", font, anchor="mm")
    sheet.save(figure, optimize=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
