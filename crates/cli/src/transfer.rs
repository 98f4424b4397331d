//! The transfer function that arguments request.

use voxsplat::program::{IsosurfaceSpec, TransferRequest};

use super::args::ModelArgs;
use super::failure::Failure;

/// Returns the transfer function that arguments request.
pub(crate) fn transfer(args: &ModelArgs) -> Result<TransferRequest, Failure> {
    let gradient = args.gradient_opacity.clone();
    let mut request = TransferRequest::new(args.transfer.as_deref(), args.window, args.transfer_values, gradient)?;
    request.classification = args.classification;
    request.isosurfaces = IsosurfaceSpec::points(&args.iso);
    Ok(request)
}
