//! The partial picture of a brick, by the processor or by a device.

use super::grid::owned;
use super::light::IncomingLight;
use super::partial::{Partial, Values};
use super::plan::{Brick, Plan};
use crate::engine::Engine;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::gpu::view::Held;
use crate::host::HostRenderer;
use crate::image::{Image, Region};
use crate::layers::Layers;
use crate::lighting::shadow::incoming::Incoming;
use crate::renderer::Renderer;
use crate::settings::Painter;
use crate::stats::Stats;

/// Draws a brick of a plan, by its place in [`Plan::bricks`], of the slice of all layers that [`Brick::held`] names.
/// The place of the slice in the world is that of the plan, whatever its own grid says. [`Engine::open`] opens an
/// engine for [`Plan::settings`]. `light` is the light that enters the brick, by [`sweep_light`](super::sweep_light) if
/// [`Plan::casts_shadows`], and otherwise `None`.
///
/// # Errors
/// [`Error::Setting`] if there is no such brick, the slice has other dimensions, the painter of the plan is of another
/// engine, the light is missing or enters another brick, and the errors of [`Engine::prepare_layers`] and
/// [`Engine::render`].
pub fn brick(
    engine: &Engine,
    plan: &Plan,
    number: usize,
    slice: &Layers,
    light: Option<&IncomingLight>,
) -> Result<(Partial, Stats)> {
    let brick = plan.brick(number)?;
    let grid = plan.grid().part(&brick.held)?;
    if slice.grid().dims() != grid.dims() {
        let (found, expected) = (slice.grid().dims(), grid.dims());
        let reason = format!("a slice of {found:?} voxels, expected {expected:?}: {:?}", brick.held);
        return Err(Error::setting("brick", reason));
    }
    let slice = slice.on_grid(&grid)?;
    let light = match light {
        Some(light) => Some(light.of(plan, number, brick)?),
        None if plan.casts_shadows() => {
            let reason = format!("the light that enters brick {number} is missing: other bricks cast shadows on it");
            return Err(Error::setting("light", reason));
        }
        None => None,
    };
    let (families, stats) = match (engine, plan.settings().painter) {
        (Engine::Host(renderer), Painter::Cpu) => by_host(renderer, plan, brick, &slice, light)?,
        (Engine::Device(renderer), Painter::Tiles | Painter::Quads(_)) => by_device(renderer, plan, brick, &slice)?,
        _ => return Err(Error::setting("painter", "it is of another engine: open the engine for the plan's settings")),
    };
    // A brick that reaches no pixel has one without matter.
    let nowhere = Region { x: 0, y: 0, width: 1, height: 1 };
    let region = families.iter().flatten().map(|(region, _)| *region).reduce(Region::around).unwrap_or(nowhere);
    let in_region = |part: &Option<(Region, Image)>| {
        let mut family = Image::transparent(region.width, region.height)?;
        part.iter().for_each(|(of, image)| family.put(image, [of.x - region.x, of.y - region.y]));
        Ok(family)
    };
    let families = families.iter().map(in_region).collect::<Result<Vec<Image>>>()?;
    let values = Values::of_model(plan.settings().model);
    let part =
        Partial { plan: plan.id(), bricks: number..number + 1, values, size: plan.camera().size, region, families };
    Ok((part, stats))
}

/// The part of a picture that each family of rays of a brick reaches, with its values; `None`: the family reaches none.
type Families = Vec<Option<(Region, Image)>>;

/// Draws a brick by the processor.
fn by_host(
    renderer: &HostRenderer,
    plan: &Plan,
    brick: &Brick,
    slice: &Layers,
    light: Option<Incoming>,
) -> Result<(Families, Stats)> {
    let first = [0, 1, 2].map(|axis| brick.held[axis].start);
    let owned = owned(plan.grid(), &brick.voxels, Held::OPEN);
    let eye = plan.camera().eye().map(|eye| plan.grid().to_lattice().transform_point3(eye));
    let has_eye = eye.is_some_and(|eye| owned[0].cmple(eye).all() && eye.cmplt(owned[1]).all());
    let scene = renderer.prepare_layers(slice, plan.settings())?;
    let scene = scene.within((*plan.grid(), first), (owned, has_eye), plan.is_uniform).entered_by(light);
    let rendered = renderer.render(&scene, &Frame::new(plan.camera(), plan.settings()))?;
    let has_matter = rendered.image.pixels().iter().map(|pixel| *pixel != [0.0; 4]);
    let width = plan.camera().size[0] as usize;
    let reached = has_matter.enumerate().filter(|(_, has_matter)| *has_matter).map(|(number, _)| {
        let [x, y] = [number % width, number / width].map(|place| place as u32);
        Region { x, y, width: 1, height: 1 }
    });
    let part = reached.reduce(Region::around).map(|region| Ok::<_, Error>((region, rendered.image.part(region)?)));
    Ok((vec![part.transpose()?], rendered.stats))
}

/// Draws a brick by a device.
fn by_device(renderer: &Renderer, plan: &Plan, brick: &Brick, slice: &Layers) -> Result<(Families, Stats)> {
    let held = plan.held(brick);
    let seen = plan.families_of(held, 1);
    let first = seen.iter().position(|&seen| seen).unwrap_or(0);
    let mut scene = renderer.prepare_layers(slice, plan.settings())?.within(*plan.grid(), held);
    scene = scene.by_family(first);
    let (part, mut stats) = renderer.render_partial(&scene, plan.camera(), plan.settings())?;
    let mut parts = vec![None; seen.len()];
    parts[first] = part;
    for family in (first + 1..seen.len()).filter(|&family| seen[family]) {
        scene = scene.by_family(family);
        let (part, next) = renderer.render_partial(&scene, plan.camera(), plan.settings())?;
        parts[family] = part;
        stats.stages.extend(next.stages);
    }
    Ok((parts, stats))
}
