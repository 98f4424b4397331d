//! Isosurfaces of one layer among the voxels of others.

use voxsplat::Frame;
use voxsplat::camera::{Camera, ProjectionKind, View};
use voxsplat::glam::DVec3;
use voxsplat::image::Image;
use voxsplat::layers::{Layer, Layers};
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Model, Settings, Shading};
use voxsplat::transfer::{ControlPoint, TransferFunction};
use voxsplat::volume::Volume;

use super::isosurfaces::{differences, settings, surface};
use crate::support::{PROJECTIONS, demo, engines, headlight};

const SIZE: u32 = 48;

fn pre_shaded() -> Settings {
    Settings { shading: Shading::Pre, ..settings() }
}

fn view(projection: ProjectionKind) -> View {
    View { azimuth: 33.0, elevation: 20.0, projection, ..View::default() }
}

/// Returns a volume, and a layer of fuzzy matter on its lattice with a largest opacity.
fn volumes(opacity: f64) -> (Volume, Layer) {
    let (volume, _) = demo("marschner-lobb", 24);
    let (other, _) = demo("shell", 24);
    let points = [surface(0.2, [0.9, 0.2, 0.1], 0.0), surface(0.9, [1.0, 0.7, 0.2], opacity)];
    let fuzzy = TransferFunction::new(points.to_vec(), Some(1.0 / 16.0)).unwrap();
    let other = other.with_grid(*volume.grid()).unwrap();
    (volume, Layer::scalars(&other, &fuzzy))
}

fn of_surfaces(volume: &Volume, surfaces: &[ControlPoint]) -> Layers {
    Layers::of_volume(volume, &TransferFunction::of_isosurfaces(surfaces).unwrap())
}

fn render(layers: &Layers, camera: &Camera, settings: &Settings) -> Image {
    let [_, host] = engines();
    let scene = host.prepare_layers(layers, settings).unwrap();
    host.render(&scene, &Frame::new(camera, settings)).unwrap().image
}

#[test]
fn pictures_are_those_of_the_reference() {
    let (volume, fuzzy) = volumes(0.4);
    let glass = [surface(0.5, [0.4, 0.6, 0.9], 0.35)];
    let nested = [surface(0.7, [0.2, 0.4, 0.9], 1.0), surface(0.35, [0.9, 0.8, 0.2], 0.4)];
    let shadowed = Lighting { shadows: 0.7, ..Lighting::studio(DVec3::Y, DVec3::Z) };
    for projection in PROJECTIONS {
        let camera = Camera::new(&view(projection), volume.grid(), [SIZE; 2]).unwrap();
        for (name, surfaces, lighting, bounds) in [
            ("unlit", &glass[..], None, [0.4, 4.0]),
            ("nested", &nested, headlight(), [1.0, 10.0]),
            ("shadowed", &nested, Some(shadowed.clone()), [3.0, 18.0]),
        ] {
            let settings = Settings { lighting, ..pre_shaded() };
            let layers = of_surfaces(&volume, surfaces).with(fuzzy.clone()).unwrap();
            let image = render(&layers, &camera, &settings);
            let truth = Reference::of_layers(&layers, &settings).unwrap().render(&camera).unwrap();
            let errors = differences(&truth, &image);
            let at = |share: f64| errors[((errors.len() - 1) as f64 * share) as usize];
            let [half, most] = [at(0.5), at(0.97)];
            println!("{name}, {projection:?}: {} pixels, half within {half:.2}, 97 % within {most:.2}", errors.len());
            assert!(
                errors.len() > 200 && half < bounds[0] && most < bounds[1],
                "{name}, {projection:?}: {half}, {most}"
            );
        }
    }
}

#[test]
fn a_layer_without_matter_changes_nothing() {
    let (volume, _) = volumes(0.4);
    let surfaces = [surface(0.7, [0.2, 0.4, 0.9], 1.0), surface(0.35, [0.9, 0.8, 0.2], 0.4)];
    let alone = of_surfaces(&volume, &surfaces);
    let clear = TransferFunction::new(vec![surface(0.0, [1.0; 3], 0.0)], None).unwrap();
    let layered = alone.clone().with(Layer::scalars(&volume, &clear)).unwrap();
    for projection in PROJECTIONS {
        let camera = Camera::new(&view(projection), volume.grid(), [SIZE; 2]).unwrap();
        let post = Settings { lighting: headlight(), ..settings() };
        let pre = Settings { lighting: headlight(), ..pre_shaded() };
        // Optical depths are added in another order.
        let most = differences(&render(&alone, &camera, &post), &render(&layered, &camera, &pre)).pop();
        assert!(most.is_some_and(|most| most < 0.01), "{projection:?}: {most:?}");
        let [_, host] = engines();
        let depths = |layers: &Layers, settings: &Settings| {
            let scene = host.prepare_layers(layers, settings).unwrap();
            host.depths(&scene, &Frame::new(&camera, settings)).unwrap()
        };
        let [of_alone, of_layered] = [depths(&alone, &post), depths(&layered, &pre)];
        let apart = of_alone
            .depths()
            .iter()
            .zip(of_layered.depths())
            .filter(|(a, b)| (*a - *b).abs() > 1e-4 || a.is_finite() != b.is_finite());
        let apart: Vec<_> = apart.collect();
        assert!(apart.is_empty(), "{projection:?}: {apart:?}");
    }
}

#[test]
fn matter_is_seen_through_surfaces_and_hidden_by_opaque_ones() {
    let (volume, fuzzy) = volumes(0.9);
    let camera = Camera::new(&view(PROJECTIONS[0]), volume.grid(), [SIZE; 2]).unwrap();
    let settings = pre_shaded();
    let red = |opacity: f64| {
        let layers = of_surfaces(&volume, &[surface(0.5, [0.0, 0.0, 1.0], opacity)]).with(fuzzy.clone()).unwrap();
        let image = render(&layers, &camera, &settings);
        image.pixels().iter().map(|p| f64::from(p[0])).sum::<f64>()
    };
    let [bare, glass, wall] = [1e-6, 0.3, 1.0].map(red);
    assert!(bare > 1.02 * glass && glass > 1.04 * wall && wall > 0.0, "{bare}, {glass}, {wall}");
}

#[test]
fn surfaces_of_masked_layers_and_of_several_are_refused() {
    let (volume, _) = volumes(0.4);
    let layer = || of_surfaces(&volume, &[surface(0.5, [1.0; 3], 1.0)]);
    let transfer = TransferFunction::of_isosurfaces(&[surface(0.5, [1.0; 3], 1.0)]).unwrap();
    let twice = layer().with(Layer::scalars(&volume, &transfer)).unwrap();
    let [_, host] = engines();
    let error = host.prepare_layers(&twice, &pre_shaded()).err().unwrap().to_string();
    assert_eq!(error, "iso: isosurfaces are of one layer of values without a mask");
    assert_eq!(Reference::of_layers(&twice, &pre_shaded()).unwrap_err().to_string(), error);
    // An X-ray has no surfaces.
    let xray = Settings { model: Model::Xray, ..pre_shaded() };
    assert!(host.prepare_layers(&twice, &xray).is_ok() && Reference::of_layers(&twice, &xray).is_ok());
}
