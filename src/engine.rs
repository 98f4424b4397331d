//! The engine that makes pictures: a graphics device, or the processor.

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::host::{HostRenderer, HostScene};
use crate::image::{DepthMap, Region};
use crate::layers::Layers;
#[cfg(feature = "gpu")]
use crate::renderer::{Renderer, Scene, check_memory, silenced};
#[cfg(feature = "gpu")]
use crate::settings::Interslice;
use crate::settings::{Painter, RendererOptions, Settings};
use crate::solids::Solids;
use crate::stats::Rendered;
use crate::stats::adapter::AdapterInfo;

/// What makes pictures.
pub enum Engine {
    /// Splats on a graphics device: with the feature `gpu`.
    #[cfg(feature = "gpu")]
    Device(Box<Renderer>),
    /// Rays on the processor.
    Host(HostRenderer),
}

/// What an [`Engine`] has prepared.
pub enum EngineScene {
    /// On the device.
    #[cfg(feature = "gpu")]
    Device(Box<Scene>),
    /// In memory.
    Host(Box<HostScene>),
}

impl EngineScene {
    /// Whether cells may stand for voxels in its pictures: those of a device, in layers that have cells.
    pub(crate) fn has_cells(&self) -> bool {
        match self {
            #[cfg(feature = "gpu")]
            Self::Device(scene) => scene.has_cells(),
            Self::Host(_) => false,
        }
    }
}

impl Engine {
    /// Opens the engine for pictures with these settings.
    ///
    /// [`Painter::Cpu`] is the processor, `options.adapter` and every other requested painter are a device. If neither
    /// is requested, the engine is a GPU if there is one and the processor otherwise: there drivers are slower than
    /// [`HostRenderer`]. On Linux no driver is loaded unless the system shows a GPU, or `VK_DRIVER_FILES` names one.
    /// Without the feature `gpu` there are no devices.
    ///
    /// # Errors
    /// [`Error::Setting`] if both an adapter and the processor are requested; [`Error::NoAdapter`] if a device is
    /// requested and there is none.
    pub fn open(options: &RendererOptions, settings: &Settings) -> Result<Self> {
        let host = |reason| Ok(Self::Host(HostRenderer::because(reason, &options.progress)));
        match (settings.painter, &options.adapter) {
            (Painter::Cpu, Some(adapter)) => {
                Err(Error::setting("adapter", format!("{adapter:?}: an adapter draws by quads or tiles")))
            }
            (Painter::Cpu, None) => host(HostRenderer::REQUESTED),
            (Painter::Auto, None) => Self::suited(options, settings),
            _ => Self::device(options),
        }
    }

    /// A device.
    #[cfg(feature = "gpu")]
    fn device(options: &RendererOptions) -> Result<Self> {
        Ok(Self::Device(Box::new(silenced(|| Renderer::new(options))?)))
    }

    #[cfg(not(feature = "gpu"))]
    fn device(_: &RendererOptions) -> Result<Self> {
        Err(Error::NoAdapter("this build has no feature gpu: use the painter cpu".to_owned()))
    }

    /// A GPU if there is one, otherwise the processor.
    #[cfg(feature = "gpu")]
    fn suited(options: &RendererOptions, settings: &Settings) -> Result<Self> {
        let host = |reason| Ok(Self::Host(HostRenderer::because(reason, &options.progress)));
        if settings.is_post_shaded() && settings.interslice == Interslice::Mean {
            return Self::device(options);
        }
        if !may_have_gpu() {
            return host("there is no GPU");
        }
        match silenced(|| Renderer::new(options)) {
            Ok(renderer) if renderer.adapter().is_software() => host("no adapter is a GPU"),
            Ok(renderer) => Ok(Self::Device(Box::new(renderer))),
            Err(Error::NoAdapter(_)) => host("no adapter can be opened"),
            Err(error) => Err(error),
        }
    }

    #[cfg(not(feature = "gpu"))]
    fn suited(options: &RendererOptions, _: &Settings) -> Result<Self> {
        Ok(Self::Host(HostRenderer::because("this build has no feature gpu", &options.progress)))
    }

    /// Refuses to open an engine in so little memory that its threads may not start, which would end the process: call
    /// it before the first thread starts.
    ///
    /// # Errors
    /// [`Error::NoAdapter`].
    pub fn check_memory() -> Result<()> {
        #[cfg(feature = "gpu")]
        check_memory()?;
        Ok(())
    }

    /// Returns the adapter or, of the processor, its vectors and threads.
    #[must_use]
    pub fn adapter(&self) -> AdapterInfo {
        match self {
            #[cfg(feature = "gpu")]
            Self::Device(renderer) => renderer.adapter().clone(),
            Self::Host(_) => HostRenderer::adapter(),
        }
    }

    /// Prepares layers for pictures with these settings.
    ///
    /// # Errors
    /// The errors of [`Renderer::prepare_layers`] and [`HostRenderer::prepare_layers`].
    pub fn prepare_layers(&self, layers: &Layers, settings: &Settings) -> Result<EngineScene> {
        Ok(match self {
            #[cfg(feature = "gpu")]
            Self::Device(renderer) => EngineScene::Device(Box::new(renderer.prepare_layers(layers, settings)?)),
            Self::Host(renderer) => EngineScene::Host(Box::new(renderer.prepare_layers(layers, settings)?)),
        })
    }

    /// Renders a picture.
    ///
    /// # Errors
    /// The errors of [`Self::render_region`].
    pub fn render(&self, scene: &EngineScene, camera: &Camera, settings: &Settings) -> Result<Rendered> {
        let [width, height] = camera.size;
        self.render_region(scene, camera, settings, Region { x: 0, y: 0, width, height }, None)
    }

    /// Renders a part of a picture, with surfaces in it if there are some.
    ///
    /// # Errors
    /// The errors of [`Renderer::render_with_solids`] and [`HostRenderer::render_with_solids`], and [`Error::Setting`]
    /// if another engine prepared the scene.
    pub fn render_region(
        &self,
        scene: &EngineScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        solids: Option<&Solids>,
    ) -> Result<Rendered> {
        match (self, scene, solids) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene), None) => {
                renderer.render_region(scene, camera, settings, region)
            }
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene), Some(solids)) => {
                renderer.render_with_solids(scene, camera, settings, region, solids)
            }
            (Self::Host(renderer), EngineScene::Host(scene), None) => {
                renderer.render_region(scene, camera, settings, region)
            }
            (Self::Host(renderer), EngineScene::Host(scene), Some(solids)) => {
                renderer.render_with_solids(scene, camera, settings, region, solids)
            }
            #[cfg(feature = "gpu")]
            _ => Err(of_another_engine()),
        }
    }

    /// Renders a whole picture, refused with [`Error::Setting`] if quads would cover over `most_fragments` pixels.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the processor draws no quads"))]
    pub(crate) fn render_within(
        &self,
        scene: &EngineScene,
        camera: &Camera,
        settings: &Settings,
        most_fragments: f64,
    ) -> Result<Rendered> {
        match (self, scene) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene)) => {
                renderer.render_within(scene, camera, settings, most_fragments)
            }
            (Self::Host(renderer), EngineScene::Host(scene)) => renderer.render(scene, camera, settings),
            #[cfg(feature = "gpu")]
            _ => Err(of_another_engine()),
        }
    }

    /// Returns the depths of a part of a picture at which rays have lost half of their light.
    ///
    /// # Errors
    /// The errors of [`Renderer::depths`] and [`HostRenderer::depths`], and [`Error::Setting`] if another engine
    /// prepared the scene.
    pub fn depths(
        &self,
        scene: &EngineScene,
        camera: &Camera,
        settings: &Settings,
        region: Region,
        solids: Option<&DepthMap>,
    ) -> Result<DepthMap> {
        match (self, scene) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene)) => {
                renderer.depths(scene, camera, settings, region, solids)
            }
            (Self::Host(renderer), EngineScene::Host(scene)) => {
                renderer.depths(scene, camera, settings, region, solids)
            }
            #[cfg(feature = "gpu")]
            _ => Err(of_another_engine()),
        }
    }
}

#[cfg(feature = "gpu")]
fn of_another_engine() -> Error {
    Error::setting("scene", "another engine prepared it")
}

/// Names of the devices of GPUs in a folder.
#[cfg(all(feature = "gpu", any(target_os = "linux", target_os = "freebsd")))]
const GPUS: [(&str, &str); 5] =
    [("/dev/dri", "renderD"), ("/dev", "nvidia"), ("/dev", "dxg"), ("/dev", "kgsl-"), ("/dev", "mali")];

/// Whether a GPU may be there, found without loading a driver.
#[cfg(all(feature = "gpu", any(target_os = "linux", target_os = "freebsd")))]
fn may_have_gpu() -> bool {
    let has = |folder: &str, start: &str| {
        let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
        files.into_iter().any(|file| file.file_name().to_string_lossy().starts_with(start))
    };
    let is_named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].into_iter().any(|name| std::env::var_os(name).is_some());
    is_named || GPUS.into_iter().any(|(folder, start)| has(folder, start))
}

/// Whether a GPU may be there: only its driver tells.
#[cfg(all(feature = "gpu", not(any(target_os = "linux", target_os = "freebsd"))))]
fn may_have_gpu() -> bool {
    true
}
