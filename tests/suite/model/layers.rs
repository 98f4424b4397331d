//! Several layers on one lattice: labels, masks and scalars, by both painters against the f64 reference.

use voxsplat::camera::ProjectionKind;
use voxsplat::error::Error;
use voxsplat::image::Image;
use voxsplat::layers::{Label, LabelChange, LabelSelection, Labels, Layer, Layers, count_labels};
use voxsplat::lighting::Lighting;
use voxsplat::reference::Reference;
use voxsplat::settings::{Level, Model, Settings, Shading};
use voxsplat::transfer::{GradientPoint, TransferFunction};
use voxsplat::volume::Volume;

use crate::support::{
    PROJECTIONS, camera, demo, draw, errors, exact_quads, full, renderer, rms_covered, thick, transfer, two_lights,
};

const N: usize = 34;

/// The label of each voxel: a ball of three labels, one of them negative and one over 2^31, in a shell of 0.
fn label(index: usize) -> i64 {
    let place = [index % N, index / N % N, index / N / N].map(|p| p as f64 - (N - 1) as f64 / 2.0);
    let [x, y, z] = place;
    let radius = (x * x + y * y + z * z).sqrt();
    match radius {
        _ if radius < 5.0 => 4_000_000_000,
        _ if radius > 12.0 => 0,
        _ if x > 1.0 => -7,
        _ if y > 2.0 || z > 5.0 => 3,
        _ => 2,
    }
}

pub(crate) fn labels() -> Volume {
    let labels: Vec<i64> = (0..N * N * N).map(label).collect();
    Volume::from_slice([N as u32; 3], [1.0, 1.0, 1.4], &labels).unwrap()
}

/// Scalars that rise along x and are noisy.
fn scan() -> (Volume, TransferFunction) {
    let noise = |i: usize| (i as u32).wrapping_mul(2_654_435_761) >> 27;
    let samples: Vec<i16> = (0..N * N * N).map(|i| (6 * (i % N) as u32 + noise(i)) as i16 - 60).collect();
    let volume = Volume::from_slice([N as u32; 3], [1.0, 1.0, 1.4], &samples).unwrap();
    let points = [(0.0, [0.2, 0.4, 1.0], 0.0), (60.0, [1.0, 0.8, 0.5], 0.2), (150.0, [1.0; 3], 0.4)];
    (volume, transfer(&points, Some(2.0)))
}

fn looks() -> Labels {
    let three = Label { name: "three".to_owned(), color: [0.1, 0.9, 0.2], opacity: 0.7 };
    let big = LabelSelection::Numbers(vec![[4_000_000_000; 2]]);
    Labels::default()
        .with(3, three)
        .changed(LabelSelection::Numbers(vec![[-7, -7]]), LabelChange::Opacity(0.1))
        .and_then(|labels| labels.changed(big, LabelChange::Color([1.0; 3])))
        .unwrap()
}

/// Samples that vary along an axis.
fn waves(axis: usize) -> Volume {
    let place = |i: usize| [i % N, i / N % N, i / N / N][axis] as f64 + 0.3 * (i % N) as f64;
    let samples: Vec<u8> = (0..N * N * N).map(|i| (127.0 + 120.0 * (0.3 * place(i)).sin()) as u8).collect();
    Volume::from_slice([N as u32; 3], [1.0, 1.0, 1.4], &samples).unwrap()
}

/// Labels alone, labels over scalars, scalars in a mask, scalars in a mask thinned by their gradient under labels, two
/// channels, and colours with opacity by luminance and by alpha.
pub(crate) fn scenes() -> [Layers; 7] {
    let (volume, transfer) = scan();
    let [red, green, blue] = [0, 1, 2].map(waves);
    let channel = |color| crate::support::transfer(&[(120.0, color, 0.0), (250.0, color, 0.3)], None);
    let labels = labels();
    let layer = || Layer::labels(&labels, &looks()).unwrap();
    let mask = |layer: Layer, which: &str| layer.masked(&labels, &which.parse().unwrap()).unwrap();
    let thin = transfer.clone().with_gradient_opacity(vec![
        GradientPoint { magnitude: 2.0, opacity: 0.3 },
        GradientPoint { magnitude: 9.0, opacity: 1.0 },
    ]);
    [
        Layers::new(layer()),
        Layers::of_volume(&volume, &transfer).with(layer()).unwrap(),
        Layers::new(mask(Layer::scalars(&volume, &transfer), "2-3")),
        Layers::new(mask(Layer::scalars(&volume, &thin.unwrap()), "all")).with(mask(layer(), "-7")).unwrap(),
        Layers::of_volume(&red, &channel([0.0, 1.0, 0.0]))
            .with(Layer::scalars(&green, &channel([1.0, 0.0, 1.0])))
            .unwrap(),
        Layers::new(Layer::colors([&red, &green, &blue], None, 255.0, &channel([0.0; 3])).unwrap()),
        Layers::new(Layer::colors([&red, &green, &blue], Some(&volume), 250.0, &transfer).unwrap()),
    ]
}

/// A picture and its truth.
fn both(layers: &Layers, settings: &Settings, projection: ProjectionKind) -> [Image; 2] {
    let camera = camera(33.0, projection, layers_volume(layers), 40);
    let scene = renderer().prepare_layers(layers, settings).unwrap();
    let truth = Reference::of_layers(layers, settings).unwrap().with_tolerance(1e-6).render(&camera).unwrap();
    [draw(&scene, &camera, settings).image, truth]
}

/// A volume on the lattice of layers.
fn layers_volume(layers: &Layers) -> &'static Volume {
    static VOLUME: std::sync::LazyLock<Volume> = std::sync::LazyLock::new(labels);
    assert_eq!(VOLUME.grid(), layers.grid());
    &VOLUME
}

/// Both painters err as much as for one volume: alpha by footprints and half floats, colours by the order of
/// matter in a slab.
#[test]
#[ignore = "slow: seven scenes by both painters in two projections, with light and without"]
fn layers_are_those_of_the_reference() {
    for (number, layers) in scenes().iter().enumerate() {
        for (lighting, projection) in [None, two_lights()].into_iter().zip(PROJECTIONS) {
            for (settings, alpha_bound, color_bound) in
                [(thick(&exact_quads(), 0.25), 1e-4, 2e-3), (full(), 1.5e-3, 1.2e-2)]
            {
                let lit = lighting.is_some();
                let settings = Settings { lighting: lighting.clone(), antialiasing: false, ..settings };
                let [image, truth] = both(layers, &settings, projection);
                let covered = truth.pixels().iter().filter(|p| p[3] > 0.2).count();
                assert!(covered > 100, "scene {number}: {covered} pixels covered");
                let (color, alpha) = errors(&image, &truth);
                println!("scene {number} {projection:?} lit {lit} {:?}: {color:e} {alpha:e}", settings.painter);
                assert!(alpha <= alpha_bound && color <= color_bound, "scene {number}: {color:e} {alpha:e}");
            }
        }
    }
}

#[test]
fn voxels_have_their_colours() {
    // A block of one colour is drawn in that colour.
    let [red, green, blue] = [200_u8, 100, 50].map(|c| Volume::from_slice([9; 3], [1.0; 3], &[c; 729]).unwrap());
    let opaque = transfer(&[(0.0, [0.0; 3], 0.9)], None);
    let layers = Layers::new(Layer::colors([&red, &green, &blue], None, 255.0, &opaque).unwrap());
    let camera = camera(0.0, ProjectionKind::Orthographic, &red, 9);
    let scene = renderer().prepare_layers(&layers, &exact_quads()).unwrap();
    let pixel = draw(&scene, &camera, &exact_quads()).image.pixels()[9 * 4 + 4];
    for (got, expected) in pixel.into_iter().zip([200.0, 100.0, 50.0, 255.0]) {
        assert!((got - expected / 255.0).abs() < 1e-3, "{pixel:?}");
    }
    let refused = |channels, white| Layer::colors(channels, None, white, &opaque).err().unwrap().to_string();
    let elsewhere = labels();
    let other = refused([&red, &green, &elsewhere], 255.0);
    assert!(other.starts_with("channel: ") && other.contains("expected that of the volume"), "{other}");
    assert_eq!(refused([&red, &green, &blue], 0.0), "white: 0, expected a number over 0");
}

#[test]
fn light_and_shadows_on_labels_are_those_of_the_reference() {
    let lighting = Some(Lighting { occlusion: Some(3.0), shadows: 0.8, ..two_lights().unwrap() });
    let settings = Settings { lighting, antialiasing: false, ..full() };
    let [image, truth] = both(&scenes()[0], &settings, ProjectionKind::Orthographic);
    let (color, alpha) = errors(&image, &truth);
    assert!(alpha <= 1.5e-3 && color <= 1.2e-2, "{color:e} {alpha:e}");
    assert!(rms_covered(&image, &truth) < 3e-3);
}

#[test]
fn an_xray_of_layers_adds_their_extinctions() {
    let settings = Settings { model: Model::Xray, antialiasing: false, ..exact_quads() };
    let [image, truth] = both(&scenes()[1], &settings, ProjectionKind::Orthographic);
    let (color, alpha) = errors(&image, &truth);
    assert!(alpha <= 1e-4 && color <= 1e-4, "{color:e} {alpha:e}");
}

/// A volume as a single layer gives the picture of the volume.
#[test]
fn one_layer_is_its_volume() {
    let (volume, transfer) = demo("vessels", 32);
    let settings = exact_quads();
    let camera = camera(33.0, ProjectionKind::Orthographic, &volume, 32);
    let scenes = [
        renderer().prepare(&volume, &transfer, &settings).unwrap(),
        renderer().prepare_layers(&Layers::of_volume(&volume, &transfer), &settings).unwrap(),
    ];
    let [alone, layer] = scenes.map(|scene| draw(&scene, &camera, &settings).image);
    assert!(alone.pixels() == layer.pixels());
    // A mask of the whole volume changes only the rounding of extinctions.
    let all = Volume::from_slice([32; 3], [1.0; 3], &[1_u8; 32 * 32 * 32]).unwrap();
    let masked = Layers::new(Layer::scalars(&volume, &transfer).masked(&all, &LabelSelection::All).unwrap());
    let masked = draw(&renderer().prepare_layers(&masked, &settings).unwrap(), &camera, &settings).image;
    let (color, alpha) = errors(&alone, &masked);
    assert!(color < 1e-5 && alpha < 1e-5, "{color:e} {alpha:e}");
}

#[test]
fn labels_are_counted() {
    let counts = count_labels(&labels()).unwrap();
    let expected = |label| (0..N * N * N).filter(|&i| self::label(i) == label).count() as u64;
    assert_eq!(counts.iter().map(|c| c.label).collect::<Vec<_>>(), [-7, 0, 2, 3, 4_000_000_000]);
    assert!(counts.iter().all(|count| count.voxels == expected(count.label)));
    let halves = Volume::from_slice([2, 1, 1], [1.0; 3], &[1.0_f32, 2.5]).unwrap();
    assert!(count_labels(&halves).unwrap_err().to_string().contains("value 2.5 is no label"));
}

#[test]
fn what_layers_are_not_drawn_by_is_refused() {
    let refused = |result: Result<(), Error>, name: &str, reason: &str| match result {
        Err(Error::Setting { name: of, reason: said }) => assert!(of == name && said.contains(reason), "{of}: {said}"),
        other => panic!("{name}: {other:?}"),
    };
    let (layers, layer) = (&scenes()[0], Layer::labels(&labels(), &looks()).unwrap());
    let prepared = |settings: &Settings| renderer().prepare_layers(layers, settings).map(drop);
    refused(prepared(&Settings { shading: Shading::Post, ..Settings::default() }), "shading", "post");
    refused(prepared(&Settings { model: Model::Mip, ..Settings::default() }), "model", "mip, and labels");
    refused(prepared(&Settings { level: Level::At(1), ..Settings::default() }), "level", "over 0");
    let (other, transfer) = demo("sphere", 16);
    refused(
        Layers::of_volume(&other, &transfer).with(layer).map(drop),
        "labels",
        "34 x 34 x 34, expected that of the volume",
    );
    let scan = Layer::scalars(&scan().0, &transfer);
    refused(scan.masked(&labels(), &LabelSelection::Numbers(vec![[90, 99]])).map(drop), "mask", "no voxel");
}

#[test]
fn an_empty_mask_and_a_volume_without_labels_are_invisible_for_a_reason() {
    let (volume, transfer) = scan();
    let grid = *volume.grid();
    let none = Volume::from_slice(grid.dims(), [1.0; 3], &vec![0_u8; grid.len() as usize]).unwrap();
    let none = none.with_grid(grid).unwrap();
    let masked = |which: LabelSelection| Layer::scalars(&volume, &transfer).masked(&none, &which).unwrap();
    let blank = Layer::labels(&none, &Labels::default()).unwrap();
    let (camera, settings) = (camera(33.0, ProjectionKind::Orthographic, &volume, 16), Settings::default());
    let masked_reason = "the volume is invisible because the mask is empty: all its values are 0";
    let blank_reason = "no label is visible because all labels are 0";
    for (layers, reasons) in [
        (Layers::new(masked(LabelSelection::All)), vec![masked_reason]),
        (Layers::new(masked(LabelSelection::Numbers(vec![[1, 3]]))), vec![masked_reason]),
        (Layers::new(blank.clone()), vec![blank_reason]),
        (Layers::new(masked(LabelSelection::All)).with(blank).unwrap(), vec![masked_reason, blank_reason]),
    ] {
        assert_eq!(layers.hidden(), reasons);
        let image = draw(&renderer().prepare_layers(&layers, &settings).unwrap(), &camera, &settings).image;
        assert!(image.pixels().iter().flatten().all(|channel| *channel == 0.0));
    }
    // A label 0 with a colour of its own, and a volume that is clear by its transfer function, are as requested.
    let red = Label { color: [1.0, 0.0, 0.0], opacity: 1.0, name: String::new() };
    let coloured = Layer::labels(&none, &Labels::default().with(0, red)).unwrap();
    assert!(Layers::new(coloured).hidden().is_empty());
    assert!(Layers::of_volume(&none, &transfer).hidden().is_empty());
}
