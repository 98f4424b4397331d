//! The engine that makes pictures: a graphics device, or the processor.

#[cfg(feature = "gpu")]
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::host::{HostRenderer, HostScene};
use crate::image::DepthMap;
use crate::layers::Layers;
#[cfg(feature = "gpu")]
use crate::renderer::{Renderer, Scene, check_memory, silenced};
#[cfg(feature = "gpu")]
use crate::settings::Interslice;
use crate::settings::{Painter, RendererOptions, Settings};
use crate::stats::Rendered;
use crate::stats::adapter::AdapterInfo;

/// An engine that makes pictures.
pub enum Engine {
    /// A graphics device, which draws splats; with the feature `gpu`.
    #[cfg(feature = "gpu")]
    Device(Arc<Renderer>),
    /// The processor, which marches rays.
    Host(HostRenderer),
}

/// A scene that an [`Engine`] has prepared.
pub enum EngineScene {
    /// A scene on a graphics device.
    #[cfg(feature = "gpu")]
    Device(Box<Scene>),
    /// A scene in memory, for the processor.
    Host(Box<HostScene>),
}

impl EngineScene {
    /// Returns whether cells may stand for voxels in pictures of the scene: a device's scene of layers that have cells.
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

    /// Opens a device.
    #[cfg(feature = "gpu")]
    fn device(options: &RendererOptions) -> Result<Self> {
        Ok(Self::Device(Arc::new(silenced(|| Renderer::new(options))?)))
    }

    #[cfg(not(feature = "gpu"))]
    fn device(_: &RendererOptions) -> Result<Self> {
        Err(Error::NoAdapter("this build has no feature gpu: use the painter cpu".to_owned()))
    }

    /// Opens a GPU if there is one, otherwise the processor.
    #[cfg(feature = "gpu")]
    fn suited(options: &RendererOptions, settings: &Settings) -> Result<Self> {
        let host = |reason| Ok(Self::Host(HostRenderer::because(reason, &options.progress)));
        if settings.is_post_shaded() && settings.interslice == Interslice::Mean {
            return Self::device(options);
        }
        if !Self::may_have_gpu() {
            return host("there is no GPU");
        }
        match silenced(|| Renderer::new(options)) {
            Ok(renderer) if renderer.adapter().is_software() => host("no adapter is a GPU"),
            Ok(renderer) => Ok(Self::Device(Arc::new(renderer))),
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

    /// Returns the adapter or, for the processor, its vectors and threads.
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
    /// The errors of [`Renderer::render`] and [`HostRenderer::render`], and [`Error::Setting`] if another engine
    /// prepared the scene.
    pub fn render(&self, scene: &EngineScene, frame: &Frame<'_>) -> Result<Rendered> {
        match (self, scene) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene)) => renderer.render(scene, frame),
            (Self::Host(renderer), EngineScene::Host(scene)) => renderer.render(scene, frame),
            #[cfg(feature = "gpu")]
            _ => Err(of_another_engine()),
        }
    }

    /// Renders a picture, refused with [`Error::Setting`] if quads would cover over `most_fragments` pixels.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "the processor draws no quads"))]
    pub(crate) fn render_within(
        &self,
        scene: &EngineScene,
        frame: &Frame<'_>,
        most_fragments: f64,
    ) -> Result<Rendered> {
        match (self, scene) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene)) => {
                renderer.render_within(scene, frame, most_fragments)
            }
            _ => self.render(scene, frame),
        }
    }

    /// Returns the depths at which rays have lost half of their light.
    ///
    /// # Errors
    /// The errors of [`Renderer::depths`] and [`HostRenderer::depths`], and [`Error::Setting`] if another engine
    /// prepared the scene.
    pub fn depths(&self, scene: &EngineScene, frame: &Frame<'_>) -> Result<DepthMap> {
        match (self, scene) {
            #[cfg(feature = "gpu")]
            (Self::Device(renderer), EngineScene::Device(scene)) => renderer.depths(scene, frame),
            (Self::Host(renderer), EngineScene::Host(scene)) => renderer.depths(scene, frame),
            #[cfg(feature = "gpu")]
            _ => Err(of_another_engine()),
        }
    }
}

#[cfg(feature = "gpu")]
impl Engine {
    /// Returns whether a GPU may be there, found without loading a driver where the system shows GPUs.
    pub(crate) fn may_have_gpu() -> bool {
        #[cfg(any(target_os = "linux", target_os = "freebsd"))]
        {
            let has = |folder: &str, start: &str| {
                let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
                files.into_iter().any(|file| file.file_name().to_string_lossy().starts_with(start))
            };
            let mut names = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].into_iter();
            names.any(|name| std::env::var_os(name).is_some())
                || GPUS.into_iter().any(|(folder, start)| has(folder, start))
        }
        // Elsewhere only the driver tells.
        #[cfg(not(any(target_os = "linux", target_os = "freebsd")))]
        true
    }
}

#[cfg(feature = "gpu")]
fn of_another_engine() -> Error {
    Error::setting("scene", "another engine prepared it")
}

/// The names of devices of GPUs, each with the folder that lists them.
#[cfg(all(feature = "gpu", any(target_os = "linux", target_os = "freebsd")))]
const GPUS: [(&str, &str); 5] =
    [("/dev/dri", "renderD"), ("/dev", "nvidia"), ("/dev", "dxg"), ("/dev", "kgsl-"), ("/dev", "mali")];
